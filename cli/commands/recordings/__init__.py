"""Recordings"""

"""Graphs"""

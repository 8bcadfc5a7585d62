"""Fit and build"""

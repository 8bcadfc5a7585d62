"""Machine"""

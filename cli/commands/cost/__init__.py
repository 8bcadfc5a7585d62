"""Accuracy and cost"""

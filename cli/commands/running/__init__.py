"""Run and touch"""

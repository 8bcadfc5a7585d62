"""Studies and experiments"""

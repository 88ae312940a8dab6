"""Repeated runs of one arm: do they agree?"""

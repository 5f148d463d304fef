"""Carries everybody's messages."""

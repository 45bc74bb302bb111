"""Corrected joint commands, and what they gain."""

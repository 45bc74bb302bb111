"""Measurements as arrays, their CSV files, and how they fall into training and test."""

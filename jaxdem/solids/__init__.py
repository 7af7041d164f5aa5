"""Surfaces that grains and fluid meet, and their motion."""

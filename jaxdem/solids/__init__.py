"""Surfaces that grains and fluid meet, and their motion: geometry alone, without contacts or flow."""

"""Scenes whose light is known exactly, to test and to show with. Pure: arrays in, arrays out."""

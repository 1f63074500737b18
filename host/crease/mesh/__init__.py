"""Meshes: read, mended, joined."""

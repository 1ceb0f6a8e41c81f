"""Furnished rooms with exact depth and instance ids: `python -m splatseg_training.rooms --help`. Needs Blender (bpy)."""

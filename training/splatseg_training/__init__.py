"""Trains the affinity network of splatseg's learned RGB-D segmenter."""

//! Class-agnostic video segmentation methods over a segmenter and a splat memory.

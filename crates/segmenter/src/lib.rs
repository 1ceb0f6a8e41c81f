//! Segmenters for splatseg: image and depth in, masks with scores out.

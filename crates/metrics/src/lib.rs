//! Video segmentation quality (VSQ) and segmentation and tracking quality (STQ).

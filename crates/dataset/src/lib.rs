//! RGB-D scenes on disk as streams of frames, writers for predictions, and a synthetic room.

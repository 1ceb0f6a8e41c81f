//! An online 3D Gaussian splat that remembers segment ids: codebook, growth, decoding, learning, PLY files.

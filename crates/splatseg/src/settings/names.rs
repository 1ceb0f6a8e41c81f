//! The names of methods, segmenters and trackers.

use splatseg_settings::choices;

choices! {
    /// The methods.
    pub enum MethodName, default FastsamSplat {
        /// A segmenter for single frames, and a splat that remembers
        FastsamSplat = "fastsam-splat",
        /// A segmenter for single frames; ids are carried by overlap with the frame before
        Fastsam = "fastsam",
        /// A segmenter for single frames, prompted with one remembered point per segment
        Fastspam = "fastspam",
        /// A tracker, prompted with the detections of a segmenter
        Sam2 = "sam2",
        /// The same, with a splat that remembers and corrects the tracker
        Sam2Splat = "sam2-splat",
    }
}

choices! {
    /// The segmenters.
    pub enum SegmenterName, default Affinity {
        /// A small network that has learned which pixels belong to one object; weights built in
        Affinity = "affinity",
        /// Built in, no weights: cuts along edges in depth, normals and colour
        Graph = "graph",
        /// The paper's network; needs weights
        Fastsam = "fastsam",
        /// Precomputed masks of any other model, one file per frame
        Masks = "masks",
        /// The scene's ground truth with errors of known kinds and rates, for comparing methods
        Oracle = "oracle",
    }
}

choices! {
    /// Where a memory is kept.
    pub enum MemoryDevice, default Cpu {
        /// The processor
        Cpu = "cpu",
        /// Any GPU
        Gpu = "gpu",
    }
}

choices! {
    /// The trackers.
    pub enum TrackerName, default Sam2 {
        /// SAM 2.1; needs tracker_weights
        Sam2 = "sam2",
        /// The scene's ground truth with errors of known kinds and rates, for comparing methods
        Sim = "sim",
    }
}

impl MethodName {
    /// Whether the method uses a tracker.
    pub fn has_tracker(self) -> bool {
        matches!(self, Self::Sam2 | Self::Sam2Splat)
    }

    /// Whether the method has a splat memory.
    pub fn has_memory(self) -> bool {
        matches!(self, Self::FastsamSplat | Self::Sam2Splat)
    }
}

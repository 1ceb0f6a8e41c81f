//! Optional rows: SAM2 and SAM2-Splat with trackers that the paper does not use, EdgeTAM and EfficientTAM.

use splatseg_models::checkpoint::Architecture;
use std::path::{Path, PathBuf};

/// A tracker other than the paper's.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OtherTracker {
    /// Its checkpoint.
    pub weights: PathBuf,
    /// Its network.
    pub network: Architecture,
}

impl OtherTracker {
    /// Returns the trackers among checkpoints, in the checkpoints' order.
    pub fn among(checkpoints: &[(PathBuf, Architecture)]) -> Vec<Self> {
        let is_tracker = |network: &Architecture| {
            matches!(network, Architecture::EdgeTam { .. } | Architecture::EfficientTam { .. })
        };
        let trackers = checkpoints.iter().filter(|(_, network)| is_tracker(network));
        trackers.map(|(weights, network)| Self { weights: weights.clone(), network: network.clone() }).collect()
    }

    /// Name in tables: the file's name without its extension, as the published files of a network differ in their names
    /// alone.
    pub fn name(&self) -> String {
        self.weights.file_stem().unwrap_or_default().to_string_lossy().into_owned()
    }

    /// The settings that select the tracker. A file of EfficientTAM does not contain how the network pools its memories;
    /// the published names do.
    pub fn changes(&self) -> Vec<String> {
        let weights = format!("tracker_weights={}", self.weights.display());
        let pooling = self.pooling().map(|pooling| format!("sam2.memory_pooling={pooling}"));
        std::iter::once(weights).chain(pooling).collect()
    }

    /// One sentence for the tables' notes.
    pub fn note(&self) -> String {
        let pooling = self.pooling().map(|pooling| format!(", {pooling} pooling of memories after the file's name"));
        format!("not in the paper: {}{}, {}", self.network, pooling.unwrap_or_default(), self.weights.display())
    }

    fn pooling(&self) -> Option<&'static str> {
        let stem = Path::new(self.weights.file_stem()?).to_str()?;
        match self.network {
            Architecture::EfficientTam { .. } if stem.ends_with("_1") => Some("weighted"),
            Architecture::EfficientTam { .. } if stem.ends_with("_2") => Some("shifted"),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn published_names_tell_how_memories_are_pooled() {
        let files = [
            ("sam2.1_hiera_base_plus.pt", Architecture::Sam2 { size: None, is_2_1: true, width: 112, blocks: 24 }),
            ("w/edgetam_1.pt", Architecture::EdgeTam { width: 48 }),
            ("w/efficienttam_s.pt", Architecture::EfficientTam { width: 384 }),
            ("w/efficienttam_s_1.pt", Architecture::EfficientTam { width: 384 }),
            ("w/efficienttam_ti_2.pt", Architecture::EfficientTam { width: 192 }),
        ];
        let trackers = OtherTracker::among(&files.map(|(file, network)| (PathBuf::from(file), network)));
        let changes: Vec<Vec<String>> = trackers.iter().map(OtherTracker::changes).collect();
        assert_eq!(changes[0], ["tracker_weights=w/edgetam_1.pt"]);
        assert_eq!(changes[1], ["tracker_weights=w/efficienttam_s.pt"]);
        assert_eq!(changes[2], ["tracker_weights=w/efficienttam_s_1.pt", "sam2.memory_pooling=weighted"]);
        assert_eq!(changes[3], ["tracker_weights=w/efficienttam_ti_2.pt", "sam2.memory_pooling=shifted"]);
        assert_eq!(trackers[3].name(), "efficienttam_ti_2");
        let note = "not in the paper: EfficientTAM-Ti, shifted pooling of memories after the file's name, w/efficienttam_ti_2.pt";
        assert_eq!(trackers[3].note(), note);
    }
}

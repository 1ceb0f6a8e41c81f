//! Finds the keyframes that have similar features: hashing of binary descriptors.
//!
//! Each table hashes a descriptor by some of its bits (Gionis, Indyk and Motwani, VLDB 1999). Descriptors of the same
//! place differ in few bits, so they agree in all bits of at least one of the tables with high probability. Unlike a
//! vocabulary, this needs no training.

use super::features::{BITS, Descriptor, Random};
use std::sync::LazyLock;

const TABLES: usize = 6;
const KEY_BITS: usize = 12;

/// The bits that each table uses.
static KEYS: LazyLock<[[usize; KEY_BITS]; TABLES]> = LazyLock::new(|| {
    let mut random = Random(0xB175);
    std::array::from_fn(|_| {
        let mut bits: Vec<usize> = (0..BITS).collect();
        std::array::from_fn(|_| bits.swap_remove(random.below(bits.len())))
    })
});

/// A feature of a keyframe.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Posting {
    /// Slot of the keyframe.
    pub(crate) slot: u16,
    /// Index of the feature in its keyframe.
    pub(crate) feature: u16,
}

/// The features of all keyframes by the values of some of their bits.
#[derive(Clone, Debug)]
pub(crate) struct FeatureIndex {
    buckets: Vec<Vec<Posting>>,
}

impl Default for FeatureIndex {
    fn default() -> Self {
        Self { buckets: vec![Vec::new(); TABLES << KEY_BITS] }
    }
}

impl FeatureIndex {
    /// Adds the features of a keyframe.
    pub(crate) fn add<'a>(&mut self, slot: u16, descriptors: impl Iterator<Item = &'a Descriptor>) {
        for (feature, descriptor) in descriptors.enumerate() {
            for bucket in buckets(descriptor) {
                self.buckets[bucket].push(Posting { slot, feature: feature as u16 });
            }
        }
    }

    /// Removes the features of a keyframe.
    pub(crate) fn remove<'a>(&mut self, slot: u16, descriptors: impl Iterator<Item = &'a Descriptor>) {
        for descriptor in descriptors {
            for bucket in buckets(descriptor) {
                self.buckets[bucket].retain(|posting| posting.slot != slot);
            }
        }
    }

    /// Calls `visit` with all features that share a bucket with a descriptor; several times if they share several.
    pub(crate) fn visit(&self, descriptor: &Descriptor, mut visit: impl FnMut(Posting)) {
        for bucket in buckets(descriptor) {
            self.buckets[bucket].iter().for_each(|posting| visit(*posting));
        }
    }
}

/// The descriptor's bucket in each table.
fn buckets(descriptor: &Descriptor) -> [usize; TABLES] {
    std::array::from_fn(|table| {
        let bits = KEYS[table].iter().map(|bit| (descriptor[bit / 64] >> (bit % 64)) as usize & 1);
        bits.fold(table, |key, bit| (key << 1) | bit)
    })
}

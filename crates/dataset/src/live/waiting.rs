//! Images of a stream that wait: their data, and pairs without a pose yet.

use crate::ros_topics::contents::StampedPlace;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

/// Data of an image, and when it was received.
#[derive(Debug)]
pub(super) struct WaitingImage {
    /// Index of its topic.
    pub(super) topic: usize,
    pub(super) data: Arc<[u8]>,
    /// Time of receipt by the receiver's clock.
    pub(super) received: Duration,
    /// Time since the first message, which never goes back.
    pub(super) elapsed: Duration,
}

/// The data of all images that wait, by message number.
#[derive(Debug, Default)]
pub(super) struct WaitingImages {
    list: BTreeMap<i64, WaitingImage>,
    bytes: usize,
}

impl WaitingImages {
    pub(super) fn insert(&mut self, number: i64, image: WaitingImage) {
        self.bytes = self.bytes.saturating_add(image.data.len());
        self.list.insert(number, image);
    }

    pub(super) fn remove(&mut self, number: i64) {
        if let Some(image) = self.list.remove(&number) {
            self.bytes = self.bytes.saturating_sub(image.data.len());
        }
    }

    pub(super) fn get(&self, image: &StampedPlace) -> Option<&WaitingImage> {
        self.list.get(&image.recorded.number)
    }

    /// Returns the number of the image that was received first, and the index of its topic.
    pub(super) fn oldest(&self) -> Option<(i64, usize)> {
        self.list.first_key_value().map(|(number, image)| (*number, image.topic))
    }

    /// Returns their total size, bytes.
    pub(super) fn bytes(&self) -> usize {
        self.bytes
    }

    pub(super) fn len(&self) -> usize {
        self.list.len()
    }
}

/// Colour and depth that belong together, and wait for the camera's pose. Both are one image if there is no depth.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pair {
    pub(super) color: StampedPlace,
    pub(super) depth: StampedPlace,
    /// When the second of them was received, as [`WaitingImage::elapsed`].
    pub(super) since: Duration,
}

impl Pair {
    /// Its images.
    pub(super) fn images(self) -> impl Iterator<Item = StampedPlace> {
        let depth = Some(self.depth).filter(|depth| depth.recorded.number != self.color.recorded.number);
        [self.color].into_iter().chain(depth)
    }
}

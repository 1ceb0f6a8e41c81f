//! A memory that has used nearly all 16-bit ids.

use splatseg_geometry::{Image, Intrinsics, MAX_16_BIT_ID, Pose, RgbdFrame, SegmentMap};
use splatseg_memory::{MemorySettings, SplatMemory};
use std::collections::BTreeSet;
use std::path::Path;

/// Saves a memory in which all 16-bit ids but `free` are permanently used, by objects far from the room.
pub fn save_nearly_full_memory(path: &Path, free: usize) {
    let used = MAX_16_BIT_ID as usize - free;
    let mut memory = SplatMemory::new(MemorySettings::default(), 0, &mut |_| {}).unwrap();
    for id in 1..=used {
        assert_eq!(memory.new_segment().unwrap() as usize, id);
    }
    let (width, height) = (256, 256);
    let seen = SegmentMap::from_fn(width, height, |column, row| {
        let id = 1 + row * width + column;
        if id <= used { id as u32 } else { 0 }
    });
    let intrinsics = Intrinsics { fx: 250.0, fy: 250.0, cx: 127.5, cy: 127.5, width, height };
    let (color, depth) = (Image::filled(width, height, [9; 3]), Image::filled(width, height, 2.0));
    let far = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 900.0, 0.0, 0.0, 0.0, 1.0];
    let pose = Pose::from_row_major(far).unwrap();
    let frame = RgbdFrame::new("far".to_owned(), color, depth, intrinsics, pose).unwrap();
    for _ in 0..2 {
        let recall = memory.recall(&frame);
        memory.update(recall, &seen, &BTreeSet::new()).unwrap();
    }
    memory.save(path).unwrap();
}

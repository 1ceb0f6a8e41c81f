//! SAM2-Splat on a long video with more objects than the memory holds.

use crate::endless_wall::show;
use splatseg_tracking::Method;

const FRAMES: usize = 250;

#[test]
fn tracks_of_forgotten_objects_end() {
    let mut most = 0;
    let method = show(FRAMES, |_, followed| most = followed.most);
    let memory = method.memory().unwrap();
    let carried = memory.map().carried_ids().len();
    assert!(carried < 100 && most <= carried + 20, "{most} tracks, {carried} things in the memory");
}

//! SAM2-Splat over a day with more things than anyone can remember.

mod endless_wall;

use endless_wall::{THINGS_PER_FRAME, show};
use splatseg_tracking::Method;

const FRAMES: usize = 250;

#[test]
fn tracks_of_what_the_memory_has_forgotten_end_and_prompts_without_an_answer_take_no_ids() {
    let mut most = 0;
    let method = show(FRAMES, |_, followed| most = followed.most);
    let memory = method.memory().unwrap();
    // One for each thing, and one that is given to the thin mask of each frame and taken back.
    assert_eq!(memory.segment_count(), FRAMES * THINGS_PER_FRAME + 1);
    let carried = memory.carried_ids().len();
    assert!(carried < 100 && most <= carried + 20, "{most} tracks, {carried} things in the memory");
}

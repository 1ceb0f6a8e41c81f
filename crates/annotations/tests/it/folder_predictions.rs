//! Folders of id images.

use crate::predicted_video::{PredictedVideo, expected, frames_and_ids, write_columns};
use splatseg_annotations::PredictionChoice;

#[test]
fn of_two_files_of_a_frame_neither_is_picked_by_the_order_of_the_folder() {
    let choice = PredictionChoice { scene: "kitchen", ..Default::default() };
    for files in [["1.png", "01.png"], ["01.png", "1.png"]] {
        let video = PredictedVideo::new(3);
        for (file, id) in files.into_iter().zip(1..) {
            write_columns(&video.path(file), [id, 0, 0, 0]);
        }
        let error = video.open("", &choice).unwrap_err();
        assert_eq!(error, "01.png and 1.png are both of frame 001, expected one file 001.png");
        // The frame's own name goes first.
        write_columns(&video.path("001.png"), [9, 0, 0, 0]);
        write_columns(&video.path("2.png"), [4, 0, 0, 0]);
        let found = frames_and_ids(&video.open("", &choice).unwrap());
        assert_eq!(found, expected(&[("001", &[9]), ("002", &[4])]));
    }
}

//! Label videos on disk: `<folder>/gt_000.png` and `<folder>/pred_000.png` and so on, 16-bit grey, pixel = id.

use splatseg_geometry::{Mask, SegmentMap};
use splatseg_metrics::{FramePrediction, ScoreSettings, VideoScore, VideoScorer};
use std::path::Path;

/// True and predicted id maps of one frame.
pub struct LabelledFrame {
    pub truth: SegmentMap,
    pub prediction: SegmentMap,
}

/// Form of the prediction passed to the scorer.
#[derive(Clone, Copy, Debug)]
pub enum PredictionForm {
    /// The id map itself.
    Ids,
    /// A mask per id, with the ids.
    Masks,
    /// A mask per id, by increasing id, without the ids.
    Unlinked,
}

/// Reads all frames of a video.
pub fn read_video(folder: &Path) -> Vec<LabelledFrame> {
    let map = |name: String| {
        let path = folder.join(name);
        let image = image::open(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display())).into_luma16();
        let (width, height) = image.dimensions();
        let ids = image.into_raw().into_iter().map(u32::from).collect();
        SegmentMap::from_pixels(width as usize, height as usize, ids).unwrap()
    };
    (0..)
        .take_while(|index| folder.join(format!("gt_{index:03}.png")).exists())
        .map(|index| LabelledFrame {
            truth: map(format!("gt_{index:03}.png")),
            prediction: map(format!("pred_{index:03}.png")),
        })
        .collect()
}

/// Scores a whole video.
pub fn score(frames: &[LabelledFrame], form: PredictionForm, settings: ScoreSettings) -> VideoScore {
    let mut scorer = VideoScorer::new(settings);
    for frame in frames {
        let masks = Mask::of_segments(&frame.prediction);
        let unlinked: Vec<Mask> = masks.iter().map(|(_, mask)| mask.clone()).collect();
        let prediction = match form {
            PredictionForm::Ids => FramePrediction::Ids(&frame.prediction),
            PredictionForm::Masks => FramePrediction::Masks(&masks),
            PredictionForm::Unlinked => FramePrediction::Unlinked(&unlinked),
        };
        scorer.push(&frame.truth, &prediction).unwrap();
    }
    scorer.finish()
}

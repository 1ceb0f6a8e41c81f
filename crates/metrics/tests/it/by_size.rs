//! Id consistency by object size: small videos with known counts, and properties of any video.

use proptest::prelude::*;
use splatseg_geometry::{Mask, SegmentId, SegmentMap};
use splatseg_metrics::{
    DatasetScore, FramePrediction, Protocol, ScoreSettings, SizeClass, SizeCounts, VideoScore, VideoScorer, Void,
};

const WIDTH: usize = 100;
const HEIGHT: usize = 60;
const CUP: Rectangle = Rectangle { id: 1, left: 10, top: 10, width: 10, height: 10 };

#[derive(Clone, Copy, Debug)]
struct Rectangle {
    id: SegmentId,
    left: usize,
    top: usize,
    width: usize,
    height: usize,
}

impl Rectangle {
    fn with_id(self, id: SegmentId) -> Self {
        Self { id, ..self }
    }

    fn covers(&self, column: usize, row: usize) -> bool {
        (self.left..self.left + self.width).contains(&column) && (self.top..self.top + self.height).contains(&row)
    }

    fn mask(&self) -> (SegmentId, Mask) {
        (self.id, Mask::from_fn(WIDTH, HEIGHT, |column, row| self.covers(column, row)))
    }
}

/// Draws the rectangles in order, later ones on top.
fn map(rectangles: &[Rectangle]) -> SegmentMap {
    SegmentMap::from_fn(WIDTH, HEIGHT, |column, row| {
        rectangles.iter().rfind(|rectangle| rectangle.covers(column, row)).map_or(0, |rectangle| rectangle.id)
    })
}

/// True and predicted rectangles of a frame.
type Frame = (Vec<Rectangle>, Vec<Rectangle>);

fn scored(frames: &[Frame], settings: ScoreSettings) -> VideoScore {
    let mut scorer = VideoScorer::new(settings);
    for (truth, predicted) in frames {
        scorer.push(&map(truth), &FramePrediction::Ids(&map(predicted))).unwrap();
    }
    scorer.finish()
}

/// Counts of a size class with the default settings.
fn counts(frames: &[Frame], class: SizeClass) -> SizeCounts {
    scored(frames, ScoreSettings::default()).counts().by_size[&class]
}

fn with_protocol(protocol: Protocol) -> ScoreSettings {
    ScoreSettings { protocol, ..ScoreSettings::default() }
}

/// A video of a cup, predicted exactly, with the given id in each frame.
fn cup_with_ids(ids: &[SegmentId]) -> Vec<Frame> {
    ids.iter().map(|id| (vec![CUP], vec![CUP.with_id(*id)])).collect()
}

#[test]
fn an_object_that_changes_its_id_once_has_two() {
    let score = scored(&cup_with_ids(&[7, 7, 7, 8]), ScoreSettings::default()).scores();
    let small = score.by_size[&SizeClass::Small];
    assert_eq!(
        (small.objects, small.found, small.ids_per_object, small.main_id),
        (1, Some(100.0), Some(2.0), Some(75.0))
    );
    // 3/4 of the object in an id of that size and 1/4 in another: (3/4)² + (1/4)².
    assert_eq!((small.aq, score.aq), (Some(62.5), Some(62.5)));
    for class in [SizeClass::Medium, SizeClass::Large] {
        let none = score.by_size[&class];
        assert_eq!((none.objects, none.aq, none.ids_per_object, none.main_id), (0, None, None, None));
    }
}

#[test]
fn an_id_that_comes_back_is_one_id() {
    let counts = counts(&cup_with_ids(&[7, 8, 7, 8, 8]), SizeClass::Small);
    assert_eq!((counts.ids, counts.main_id_frames, counts.frames), (2, 3, 5));
}

#[test]
fn a_neighbour_that_spills_over_adds_no_id() {
    let spilling = Rectangle { id: 9, left: 16, top: 0, width: 40, height: 40 };
    let own = vec![CUP.with_id(7)];
    let spilt_over = vec![CUP.with_id(7), spilling];
    let frames = [own, spilt_over, vec![spilling], Vec::new()].map(|predicted| (vec![CUP], predicted));
    let small = counts(&frames, SizeClass::Small);
    // The second frame has 60 % of the cup in its own id; the last two have no id.
    assert_eq!((small.found, small.ids, small.main_id_frames, small.frames), (1, 1, 2, 4));
    let never = counts(&frames[2..], SizeClass::Small);
    assert_eq!((never.objects, never.found, never.ids, never.main_id_frames, never.frames), (1, 0, 0, 0, 2));
}

#[test]
fn an_id_covers_more_than_half_of_the_object() {
    let half = Rectangle { width: 5, ..CUP.with_id(7) };
    let other_half = Rectangle { left: 15, width: 5, ..CUP.with_id(8) };
    let pixel = Rectangle { left: 15, width: 1, height: 1, ..CUP.with_id(7) };
    let halves = vec![half, other_half];
    assert_eq!(counts(&[(vec![CUP], halves.clone())], SizeClass::Small).ids, 0);
    let more = counts(&[(vec![CUP], [halves, vec![pixel]].concat())], SizeClass::Small);
    assert_eq!((more.ids, more.main_id_frames), (1, 1));
}

#[test]
fn a_mask_that_swallows_the_object_is_its_id() {
    let table = Rectangle { id: 9, left: 0, top: 5, width: 80, height: 40 };
    let truth = vec![table.with_id(2), CUP];
    let frames = [(truth.clone(), vec![table, CUP.with_id(7)]), (truth, vec![table])];
    let small = counts(&frames, SizeClass::Small);
    assert_eq!((small.ids, small.main_id_frames, small.frames), (2, 1, 2));
    let medium = counts(&frames, SizeClass::Medium);
    assert_eq!((medium.ids, medium.main_id_frames, medium.frames), (1, 2, 2));
}

#[test]
fn the_smallest_overlapping_mask_gives_the_id() {
    let everything = Rectangle { id: 3, left: 0, top: 0, width: WIDTH, height: HEIGHT };
    let handle = Rectangle { width: 3, ..CUP.with_id(5) };
    for protocol in [Protocol::Paper, Protocol::Strict] {
        let mut scorer = VideoScorer::new(with_protocol(protocol));
        for masks in [[everything, CUP.with_id(7)], [everything, handle]] {
            scorer.push(&map(&[CUP]), &FramePrediction::Masks(&masks.map(|mask| mask.mask()))).unwrap();
        }
        let small = scorer.finish().counts().by_size[&SizeClass::Small];
        // The mask that covers everything keeps 70 % of the cup, without the handle.
        assert_eq!((small.ids, small.main_id_frames, small.frames), (2, 1, 2), "{protocol:?}");
    }
}

#[test]
fn masks_without_ids_get_ids_by_linking() {
    let elsewhere = Rectangle { id: 2, left: 60, top: 30, width: 20, height: 10 };
    let (cup, other) = (CUP.mask().1, elsewhere.mask().1);
    let frames = [vec![cup.clone(), other.clone()], vec![other.clone(), cup.clone()], vec![other], vec![cup]];
    for protocol in [Protocol::Paper, Protocol::Strict] {
        let mut scorer = VideoScorer::new(with_protocol(protocol));
        for masks in &frames {
            scorer.push(&map(&[CUP, elsewhere]), &FramePrediction::Unlinked(masks)).unwrap();
        }
        let small = scorer.finish().counts().by_size[&SizeClass::Small];
        // The cup's tube ends in the frame without a mask and a new one begins. The other object has one tube.
        let cup_and_other = (2 + 1, 2 + 3, 4 + 4);
        assert_eq!((small.ids, small.main_id_frames, small.frames), cup_and_other, "{protocol:?}");
    }
}

#[test]
fn sizes_are_means_over_the_frames_that_show_the_object() {
    let sized = |id, width, height| Rectangle { id, left: 0, top: 0, width, height };
    let class_of = |frames: &[Vec<Rectangle>]| {
        let frames: Vec<Frame> = frames.iter().map(|truth| (truth.clone(), Vec::new())).collect();
        let by_size = scored(&frames, ScoreSettings::default()).counts().by_size.clone();
        let classes: Vec<SizeClass> = SizeClass::ALL.into_iter().filter(|class| by_size[class].objects == 1).collect();
        assert_eq!(classes.len(), 1);
        classes[0]
    };
    assert_eq!(class_of(&[vec![sized(1, 19, 21)]]), SizeClass::Small);
    assert_eq!(class_of(&[vec![sized(1, 20, 20)]]), SizeClass::Medium);
    assert_eq!(class_of(&[vec![sized(1, 80, 50)]]), SizeClass::Medium);
    assert_eq!(class_of(&[vec![sized(1, 80, 50)], vec![sized(1, 81, 50)]]), SizeClass::Large);
    assert_eq!(class_of(&[vec![sized(1, 20, 20)], vec![sized(1, 20, 19)]]), SizeClass::Small);
    assert_eq!(class_of(&[vec![sized(1, 20, 20)], Vec::new(), Vec::new()]), SizeClass::Medium);
}

#[test]
fn settings_apply() {
    let spilling = Rectangle { height: 20, ..CUP.with_id(7) };
    let frames = [(vec![CUP], vec![spilling])];
    for (void, aq) in [(Void::Counted, 50.0), (Void::Excluded, 100.0)] {
        let settings = ScoreSettings { void, ..ScoreSettings::default() };
        assert_eq!(scored(&frames, settings).scores().by_size[&SizeClass::Small].aq, Some(aq));
    }
    // A frame in which the object is too small is not counted.
    let sliver = Rectangle { width: 1, ..CUP };
    let frames = [(vec![CUP], vec![CUP.with_id(7)]), (vec![sliver], vec![sliver.with_id(8)])];
    let settings = ScoreSettings { min_ground_truth_area: 0.01, ..ScoreSettings::default() };
    let small = scored(&frames, settings).counts().by_size[&SizeClass::Small];
    assert_eq!((small.frames, small.ids), (1, 1));
}

#[test]
fn counts_of_an_older_version_are_refused() {
    let mut value = serde_json::to_value(scored(&cup_with_ids(&[7]), ScoreSettings::default())).unwrap();
    assert!(serde_json::from_value::<VideoScore>(value.clone()).is_ok());
    value["counts"].as_object_mut().unwrap().remove("by_size").unwrap();
    assert!(serde_json::from_value::<VideoScore>(value).unwrap_err().to_string().contains("by_size"));
}

fn rectangles(count: std::ops::RangeInclusive<usize>) -> impl Strategy<Value = Vec<Rectangle>> {
    let rectangle = (1u32..6, 0usize..WIDTH, 0usize..HEIGHT, 1usize..=WIDTH, 1usize..=HEIGHT)
        .prop_map(|(id, left, top, width, height)| Rectangle { id, left, top, width, height });
    prop::collection::vec(rectangle, count)
}

fn videos() -> impl Strategy<Value = Vec<Frame>> {
    prop::collection::vec((rectangles(0..=5), rectangles(0..=5)), 1..5)
}

fn settings() -> impl Strategy<Value = ScoreSettings> {
    let protocol = prop_oneof![Just(Protocol::Paper), Just(Protocol::Strict)];
    let void = prop_oneof![Just(Void::Counted), Just(Void::Excluded)];
    let smallest = prop_oneof![Just(0.0), Just(0.05)];
    (protocol, void, smallest).prop_map(|(protocol, void, min_ground_truth_area)| ScoreSettings {
        protocol,
        void,
        min_ground_truth_area,
    })
}

fn close(first: f64, second: f64) -> bool {
    (first - second).abs() < 1e-9
}

/// Scores a video with one id per pixel, with overlapping masks, or with masks without ids.
fn scored_as(form: usize, frames: &[Frame], settings: ScoreSettings) -> VideoScore {
    let mut scorer = VideoScorer::new(settings);
    for (truth, predicted) in frames {
        // Masks with different ids, as each id may occur only once.
        let masks: Vec<(SegmentId, Mask)> = (1..).zip(predicted).map(|(id, mask)| mask.with_id(id).mask()).collect();
        let bare: Vec<Mask> = masks.iter().map(|(_, mask)| mask.clone()).collect();
        let flat = map(predicted);
        let prediction = match form {
            0 => FramePrediction::Ids(&flat),
            1 => FramePrediction::Masks(&masks),
            _ => FramePrediction::Unlinked(&bare),
        };
        scorer.push(&map(truth), &prediction).unwrap();
    }
    scorer.finish()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn the_classes_add_up_to_stq(frames in videos(), settings in settings(), form in 0usize..3) {
        let score = scored_as(form, &frames, settings);
        let counts = score.counts();
        let sum: f64 = counts.by_size.values().map(|counts| counts.sum_association).sum();
        prop_assert!(close(sum, counts.stq.sum_association), "{:?}", counts);
        prop_assert_eq!(counts.by_size.values().map(|counts| counts.objects).sum::<u64>(), counts.stq.tracks);
        for counts in counts.by_size.values() {
            prop_assert!(counts.found <= counts.objects && counts.found <= counts.ids, "{:?}", counts);
            prop_assert!(counts.ids <= counts.frames && counts.main_id_frames <= counts.frames, "{:?}", counts);
        }
    }

    #[test]
    fn the_sum_of_two_videos_is_their_pool(first in videos(), second in videos(), settings in settings()) {
        let mut sum = DatasetScore::new(settings);
        sum.add(&scored(&first, settings)).unwrap();
        sum.add(&scored(&second, settings)).unwrap();
        // Both videos as one, with objects and ids of the second renumbered to differ from the first.
        let others = |rectangles: &[Rectangle]| rectangles.iter().map(|r| r.with_id(r.id + 50)).collect();
        let second = second.iter().map(|(truth, predicted)| (others(truth), others(predicted)));
        let pooled: Vec<Frame> = first.into_iter().chain(second).collect();
        let pool = scored(&pooled, settings);
        for class in SizeClass::ALL {
            let (sum, pool) = (sum.counts().by_size[&class], pool.counts().by_size[&class]);
            prop_assert!(close(sum.sum_association, pool.sum_association));
            prop_assert_eq!(SizeCounts { sum_association: 0.0, ..sum }, SizeCounts { sum_association: 0.0, ..pool });
        }
    }

    #[test]
    fn a_perfect_prediction_has_one_id_per_object(frames in videos(), settings in settings()) {
        let settings = ScoreSettings { min_ground_truth_area: 0.0, ..settings };
        let perfect = |truth: &[Rectangle]| truth.iter().map(|r| r.with_id(100 - r.id)).collect();
        let frames: Vec<Frame> = frames.into_iter().map(|(truth, _)| (truth.clone(), perfect(&truth))).collect();
        for scores in scored(&frames, settings).scores().by_size.values().filter(|scores| scores.objects > 0) {
            prop_assert!(close(scores.aq.unwrap(), 100.0));
            prop_assert_eq!((scores.found, scores.ids_per_object, scores.main_id), (Some(100.0), Some(1.0), Some(100.0)));
        }
    }
}

//! A slow, obvious reference for the scorer, with one boolean per pixel of every tube and enumerated assignments.

use splatseg_metrics::{Protocol, ScoreSettings, Void, WindowLength};
use std::collections::BTreeMap;

/// One frame: true ids and predicted masks, row-major.
#[derive(Clone, Debug)]
pub struct SlowFrame {
    pub truth: Vec<u32>,
    /// Masks with their ids. The ids are ignored for unlinked predictions.
    pub masks: Vec<(u32, Vec<bool>)>,
}

/// The reference's counts.
#[derive(Debug, Default)]
pub struct SlowScore {
    /// Summed IoU, 2 TP + FP + FN, and number of windows, by window length.
    pub vsq: Vec<(f64, usize, usize)>,
    pub sum_association: f64,
    pub tracks: usize,
    /// Numbers of pixels both labelled and predicted, only labelled, and only predicted.
    pub coverage: (usize, usize, usize),
    /// True if another linking of masks would have been as good.
    pub ambiguous_links: bool,
}

type Tube = Vec<bool>;

fn overlap(first: &[bool], second: &[bool]) -> f64 {
    first.iter().zip(second).filter(|(a, b)| **a && **b).count() as f64
}

fn area(tube: &[bool]) -> f64 {
    tube.iter().filter(|inside| **inside).count() as f64
}

fn iou(first: &[bool], second: &[bool]) -> f64 {
    let shared = overlap(first, second);
    if shared == 0.0 { 0.0 } else { shared / (area(first) + area(second) - shared) }
}

fn f_score(first: &[bool], second: &[bool]) -> f64 {
    let shared = overlap(first, second);
    if shared == 0.0 { 0.0 } else { 2.0 * shared / (area(first) + area(second)) }
}

/// Enumerates all partial assignments of rows to columns over pairs with a positive first weight, as (sum of the first
/// weight, sum of the second, column of each row).
fn assignments(weights: &[Vec<(f64, f64)>]) -> Vec<(f64, f64, Vec<Option<usize>>)> {
    let mut all = vec![(0.0, 0.0, Vec::new())];
    for row in weights {
        let mut longer = Vec::new();
        for (first, second, columns) in all {
            for (column, weight) in row.iter().enumerate() {
                if weight.0 > 0.0 && !columns.contains(&Some(column)) {
                    let mut with = columns.clone();
                    with.push(Some(column));
                    longer.push((first + weight.0, second + weight.1, with));
                }
            }
            let mut without = columns;
            without.push(None);
            longer.push((first, second, without));
        }
        all = longer;
    }
    all
}

/// Returns the best assignment, and true if a different assignment has the same sum of first weights.
fn best(weights: &[Vec<(f64, f64)>]) -> (f64, f64, Vec<Option<usize>>, bool) {
    let all = assignments(weights);
    let top = all.iter().map(|a| a.0).fold(0.0, f64::max);
    let mut tied: Vec<_> = all.into_iter().filter(|a| a.0 > top - 1e-9).collect();
    tied.sort_by(|a, b| b.1.total_cmp(&a.1));
    let ambiguous = tied.len() > 1;
    let (first, second, columns) = tied.swap_remove(0);
    (first, second, columns, ambiguous)
}

/// Numbers the masks, with the same number for linked masks of consecutive frames.
fn linked(frames: &[SlowFrame], protocol: Protocol) -> (Vec<SlowFrame>, bool) {
    let (mut result, mut ambiguous, mut next) = (Vec::<SlowFrame>::new(), false, 0);
    let mut before: Vec<(u32, Vec<bool>)> = Vec::new();
    for frame in frames {
        let mut now: Vec<(u32, Vec<bool>)> = frame.masks.iter().map(|(_, mask)| (0, mask.clone())).collect();
        if now.is_empty() && protocol == Protocol::Paper {
            now.push((0, vec![false; frame.truth.len()]));
        }
        let weights: Vec<Vec<(f64, f64)>> =
            before.iter().map(|(_, old)| now.iter().map(|(_, new)| (f_score(old, new), 0.0)).collect()).collect();
        let (_, _, columns, tie) = best(&weights);
        ambiguous |= tie;
        for (row, column) in columns.iter().enumerate() {
            if let Some(column) = column {
                now[*column].0 = before[row].0;
            }
        }
        for (number, _) in now.iter_mut().filter(|(number, _)| *number == 0) {
            next += 1;
            *number = next;
        }
        before = now.clone();
        result.push(SlowFrame { truth: frame.truth.clone(), masks: now });
    }
    (result, ambiguous)
}

/// Removes small true segments and, with [`Void::Excluded`], predictions on unlabelled pixels. Masks that lose all
/// their pixels disappear.
fn cleaned(frames: Vec<SlowFrame>, settings: &ScoreSettings) -> Vec<SlowFrame> {
    let clean = |frame: SlowFrame| {
        let pixels = frame.truth.len() as f64;
        let large = |id: u32| {
            frame.truth.iter().filter(|other| **other == id).count() as f64 >= settings.min_ground_truth_area * pixels
        };
        let truth: Vec<u32> = frame.truth.iter().map(|id| if large(*id) { *id } else { 0 }).collect();
        let kept = |inside: bool, id: u32| inside && (settings.void == Void::Counted || id != 0);
        let masks = frame
            .masks
            .into_iter()
            .map(|(id, mask)| (id, area(&mask), mask.iter().zip(&truth).map(|(m, t)| kept(*m, *t)).collect::<Tube>()))
            .filter(|(_, before, mask)| area(mask) > 0.0 || *before == 0.0)
            .map(|(id, _, mask)| (id, mask))
            .collect();
        SlowFrame { truth, masks }
    };
    frames.into_iter().map(clean).collect()
}

/// The pixels of every nonempty true tube.
fn true_tubes(frames: &[SlowFrame]) -> Vec<Tube> {
    let all: Vec<u32> = frames.iter().flat_map(|frame| frame.truth.clone()).collect();
    let mut ids = all.clone();
    ids.sort_unstable();
    ids.dedup();
    ids.into_iter().filter(|id| *id != 0).map(|id| all.iter().map(|other| *other == id).collect()).collect()
}

/// The pixels of every predicted tube, by id.
fn predicted_tubes(frames: &[SlowFrame]) -> BTreeMap<u32, Tube> {
    let pixels = frames.first().map_or(0, |frame| frame.truth.len());
    let mut tubes = BTreeMap::new();
    for (index, frame) in frames.iter().enumerate() {
        for (id, mask) in &frame.masks {
            let tube: &mut Tube = tubes.entry(*id).or_insert_with(|| vec![false; pixels * frames.len()]);
            tube[index * pixels..(index + 1) * pixels].copy_from_slice(mask);
        }
    }
    tubes
}

/// Type of a prediction: masks with or without ids.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Linked {
    Ids,
    No,
}

/// Returns frames with one number per tube, and true if another linking would have been as good.
fn numbered(frames: &[SlowFrame], links: Linked, protocol: Protocol) -> (Vec<SlowFrame>, bool) {
    match links {
        Linked::Ids => (frames.to_vec(), false),
        Linked::No => linked(frames, protocol),
    }
}

/// Assigns every pixel to the smallest mask that contains it. Ties go to the first.
fn flattened(frame: SlowFrame) -> SlowFrame {
    let mut order: Vec<usize> = (0..frame.masks.len()).collect();
    order.sort_by_key(|index| area(&frame.masks[*index].1) as usize);
    let mut masks = frame.masks.clone();
    for (place, index) in order.iter().enumerate() {
        for above in &order[..place] {
            for (pixel, taken) in frame.masks[*above].1.iter().enumerate() {
                masks[*index].1[pixel] &= !taken;
            }
        }
    }
    SlowFrame { truth: frame.truth, masks }
}

pub fn slow_score(frames: &[SlowFrame], links: Linked, settings: &ScoreSettings) -> SlowScore {
    let mut score = SlowScore::default();
    for length in WindowLength::ALL {
        let counts = slow_vsq(frames, length.frames(), links, settings, &mut score.ambiguous_links);
        score.vsq.push(counts);
    }
    let (numbered, ambiguous) = numbered(frames, links, settings.protocol);
    score.ambiguous_links |= ambiguous;
    let one_per_pixel = match settings.protocol {
        Protocol::Paper => numbered,
        Protocol::Strict => numbered.into_iter().map(flattened).collect(),
    };
    let frames = cleaned(one_per_pixel, settings);
    let (truth, predicted) = (true_tubes(&frames), predicted_tubes(&frames));
    score.tracks = truth.len();
    for track in &truth {
        for tube in predicted.values() {
            score.sum_association += overlap(track, tube) * iou(track, tube) / area(track);
        }
    }
    for frame in &frames {
        for (pixel, id) in frame.truth.iter().enumerate() {
            let predicted = frame.masks.iter().any(|(_, mask)| mask[pixel]);
            score.coverage.0 += usize::from(*id != 0 && predicted);
            score.coverage.1 += usize::from(*id != 0 && !predicted);
            score.coverage.2 += usize::from(*id == 0 && predicted);
        }
    }
    score
}

fn slow_vsq(
    frames: &[SlowFrame],
    length: usize,
    links: Linked,
    settings: &ScoreSettings,
    ambiguous: &mut bool,
) -> (f64, usize, usize) {
    let protocol = settings.protocol;
    let fits = |start: &usize| match protocol {
        Protocol::Paper => start + 15 < frames.len(),
        Protocol::Strict => start + length <= frames.len(),
    };
    let (mut sum_iou, mut tubes, mut windows, mut to_find) = (0.0, 0, 0, 0);
    for start in (0..frames.len()).step_by(15).filter(fits) {
        let (window, tie) = numbered(&frames[start..start + length], links, protocol);
        *ambiguous |= tie;
        let window = cleaned(window, settings);
        let empty_tubes_count = links == Linked::No && protocol == Protocol::Paper;
        let truth = true_tubes(&window);
        let mut predicted: Vec<Tube> = predicted_tubes(&window).into_values().collect();
        predicted.retain(|tube| empty_tubes_count || area(tube) > 0.0);
        let weight = |truth: &Tube, tube: &Tube| {
            let iou = iou(truth, tube);
            match protocol {
                Protocol::Paper => (f_score(truth, tube), iou),
                Protocol::Strict => (iou, if iou > 0.5 { iou } else { 0.0 }),
            }
        };
        let weights: Vec<Vec<(f64, f64)>> =
            truth.iter().map(|t| predicted.iter().map(|p| weight(t, p)).collect()).collect();
        sum_iou += best(&weights).1;
        tubes += truth.len() + predicted.len();
        to_find += truth.len();
        windows += 1;
    }
    if protocol == Protocol::Paper && to_find == 0 { (0.0, 0, windows) } else { (sum_iou, tubes, windows) }
}

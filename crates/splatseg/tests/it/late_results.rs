//! Frames that wait, and are decided again with what the frames after them have shown.

use splatseg::dataset::Scene;
use splatseg::geometry::{Mask, RemappedId, RgbdFrame};
use splatseg::objects::RemapLog;
use splatseg::odometry::PoseState;
use splatseg::pipeline::{FrameResult, LateFrame, WaitingFrames};
use splatseg::tracking::{Hindsight, ShownFrame};
use splatseg::{Pipeline, SegmentId, SegmentMap, Settings};
use splatseg_test_scenes::room;
use std::collections::BTreeMap;

const FRAMES: usize = 9;

/// Results for the frames of a room at the time, and as they are decided `lag` frames later.
fn results(lag: Option<usize>) -> (Vec<SegmentMap>, Vec<SegmentMap>) {
    let scene = room(&format!("synthetic:frames={FRAMES},width=128,height=96,noise=kinect"));
    let mut pipeline = Pipeline::builder(&Settings::default()).build().unwrap();
    let (mut waiting, mut shown, mut late) = (WaitingFrames::default(), Vec::new(), Vec::new());
    for index in 0..FRAMES {
        let frame = scene.read_frame(index).unwrap();
        let result = pipeline.step(&frame).unwrap();
        shown.push(result.output.segments.clone());
        let Some(lag) = lag else { continue };
        waiting.add(frame, result, index);
        while let Some(LateFrame { result, belongings, .. }) =
            waiting.next_due(&mut pipeline, |_, after| after >= lag).unwrap()
        {
            assert_eq!([belongings, index], [late.len(), late.len() + lag], "each in its turn");
            assert_eq!(result.objects.len(), result.output.segments.areas().keys().filter(|id| **id != 0).count());
            late.push(result.output.segments);
        }
    }
    while let Some(frame) = waiting.next_due(&mut pipeline, |_, _| true).unwrap() {
        late.push(frame.result.output.segments);
    }
    (shown, late)
}

#[test]
fn frames_are_decided_again_in_their_order_and_change_no_later_ones() {
    let (at_the_time, _) = results(None);
    let (shown, late) = results(Some(3));
    assert_eq!(shown, at_the_time);
    assert_eq!(late.len(), FRAMES);
    assert_ne!(late, shown);
    let (_, again) = results(Some(3));
    assert_eq!(late, again, "the same every time");
}

#[test]
fn waiting_for_all_frames_is_looking_back_from_the_end() {
    let (_, late) = results(Some(FRAMES));
    let scene = room(&format!("synthetic:frames={FRAMES},width=128,height=96,noise=kinect"));
    let mut pipeline = Pipeline::builder(&Settings::default()).build().unwrap();
    let frames: Vec<_> = (0..FRAMES).map(|index| scene.read_frame(index).unwrap()).collect();
    let results: Vec<_> = frames.iter().map(|frame| pipeline.step(frame).unwrap()).collect();
    pipeline.settle();
    for ((frame, result), late) in frames.iter().zip(results).zip(late) {
        let shown = ShownFrame { segments: result.output.segments, regions: result.regions };
        assert_eq!(pipeline.hindsight().unwrap().look_again(frame, &shown).unwrap().segments, late);
    }
}

#[test]
fn an_object_that_hindsight_shows_before_the_time_is_new_in_that_frame_alone() {
    const FRAMES: usize = 24;
    let scene = room(&format!("synthetic:frames={FRAMES},width=160,height=120,noise=kinect,seed=5"));
    let mut pipeline = Pipeline::builder(&Settings::default()).build().unwrap();
    let (mut waiting, mut at_the_time) = (WaitingFrames::default(), BTreeMap::new());
    let mut first: BTreeMap<SegmentId, usize> = BTreeMap::new();
    for index in 0..FRAMES + 4 {
        if index < FRAMES {
            let frame = scene.read_frame(index).unwrap();
            let result = pipeline.step(&frame).unwrap();
            assert!(result.remapped.is_empty());
            for object in &result.objects {
                at_the_time.entry(object.id).or_insert(index);
            }
            waiting.add(frame, result, index);
        }
        let Some(late) = waiting.next_due(&mut pipeline, |frame, _| frame + 4 == index).unwrap() else { continue };
        for object in &late.result.objects {
            let shown = *first.entry(object.id).or_insert(late.belongings);
            assert_eq!((object.first_frame, object.last_frame), (shown, late.belongings), "object {}", object.id);
        }
    }
    let earlier = first.iter().filter(|(id, late)| at_the_time.get(id).is_some_and(|shown| late < &shown)).count();
    assert!(earlier > 0, "hindsight finds no object earlier");
}

/// The first frame of the room and its result, whose pose is said to be lost, so that it shows what it showed, and its two
/// largest objects, the older one first.
fn lost_frame(pipeline: &mut Pipeline) -> (RgbdFrame<'static>, FrameResult, [SegmentId; 2]) {
    let frame = room("synthetic:frames=4,width=128,height=96,noise=kinect").read_frame(0).unwrap();
    let mut result = pipeline.step(&frame).unwrap();
    result.pose.state = PoseState::Lost;
    let mut objects: Vec<(usize, SegmentId)> = result.objects.iter().map(|object| (object.area, object.id)).collect();
    objects.sort_unstable();
    let [.., one, other] = objects.as_slice() else { panic!("{objects:?}") };
    let ids = [one.1.min(other.1), one.1.max(other.1)];
    (frame, result, ids)
}

#[test]
fn frames_that_wait_get_the_ids_that_others_get_in_the_end() {
    let mut pipeline = Pipeline::builder(&Settings::default()).build().unwrap();
    let (frame, mut result, [older, newer]) = lost_frame(&mut pipeline);
    result.output.masks = Mask::of_segments(&result.output.segments);
    let areas = result.output.segments.areas();
    let (mut latest, count) = (result.clone(), result.output.masks.len());
    let mut waiting = WaitingFrames::default();
    waiting.add(frame.clone(), result, ());
    // One after the other, as a loop closure may find them.
    latest.remapped = vec![RemappedId { from: newer, into: 900 }, RemappedId { from: 900, into: older }];
    let mut log = RemapLog::default();
    log.add(1, &latest.remapped);
    assert_eq!(log.final_ids(0)[&newer], older);
    waiting.add(frame, latest, ());
    let late = waiting.next_due(&mut pipeline, |(), _| true).unwrap().unwrap().result;
    let expected = areas[&older] + areas[&newer];
    assert_eq!(late.output.segments.areas().get(&older), Some(&expected));
    let masks: BTreeMap<SegmentId, usize> = late.output.masks.iter().map(|(id, mask)| (*id, mask.area())).collect();
    assert_eq!((late.output.masks.len(), masks.len(), masks.get(&older)), (count - 1, count - 1, Some(&expected)));
    let object = late.objects.iter().find(|object| object.id == older).unwrap();
    assert_eq!(object.area, expected);
    assert!(late.objects.iter().all(|object| object.id != newer && object.id != 900));
}

#[test]
fn an_object_that_gets_another_id_meanwhile_is_not_new() {
    let scene = room("synthetic:frames=4,width=128,height=96,noise=kinect");
    let mut pipeline = Pipeline::builder(&Settings::default()).build().unwrap();
    let (mut waiting, mut renamed, mut shown) = (WaitingFrames::default(), None, 0);
    for index in 0..4 {
        let frame = scene.read_frame(index).unwrap();
        let mut result = pipeline.step(&frame).unwrap();
        if let Some(remapped @ RemappedId { from, into }) = renamed {
            // As if a loop had been closed in the last frame.
            result.remapped = vec![remapped];
            result.output.segments.pixels_mut().iter_mut().filter(|id| **id == from).for_each(|id| *id = into);
        }
        // The pose is lost, so that the frame shows what it showed.
        result.pose.state = PoseState::Lost;
        let largest = result.objects.iter().max_by_key(|object| object.area).unwrap().id;
        waiting.add(frame, result, ());
        let late = waiting.next_due(&mut pipeline, |(), _| true).unwrap().unwrap();
        if let Some(RemappedId { into, .. }) = renamed {
            let object = late.result.objects.iter().find(|object| object.id == into).unwrap();
            assert!(!object.is_new());
            shown += 1;
        }
        renamed = (index == 2).then_some(RemappedId { from: largest, into: 900 });
    }
    assert_eq!(shown, 1);
}

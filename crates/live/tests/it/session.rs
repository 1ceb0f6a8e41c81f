//! A session on the messages of a small recording: what it publishes, saves and answers.

use crate::support::{Published, Setting, feed, play, recording, setting, setting_with};
use glam::Vec3;
use splatseg::memory::SplatMemory;
use splatseg::pipeline::NamedMap;
use splatseg::segmenter::Detail;
use splatseg::settings::SettingsLayers;
use splatseg::tracking::{FastSamSplat, FastSamSplatSettings, FrameOutput, Method, TrackingError};
use splatseg::{Pipeline, Segmentation, Settings};
use splatseg_dataset::{DatasetSettings, MatchLimits, read_messages};
use splatseg_geometry::{MapView, RemappedId, RgbdFrame};
use splatseg_live::{
    BuildPipeline, LiveFrame, LiveOptions, LiveRequest, LiveSession, LiveStatus, LiveStream, Outlet, Output, SavedMap,
};
use splatseg_objects::{Object, ObjectList, SceneGraph};
use splatseg_places::PlanSettings;
use splatseg_ros::{
    Detection3dArray, DiagnosticArray, Image, MarkerArray, OccupancyGrid, PointCloud2, TextMessage, from_cdr,
};
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

#[test]
fn messages_agree_with_the_saved_objects() {
    let folder = tempfile::tempdir().unwrap();
    let saved = SavedMap::new(folder.path().join("home.ply"));
    let mut setting = setting(LiveOptions { saved_map: Some(saved.clone()), ..LiveOptions::default() }, None);
    play(&mut setting);
    assert_eq!((setting.session.status().frames, setting.session.status().skipped), (4, 0));

    let list: ObjectList = serde_json::from_slice(&std::fs::read(saved.objects()).unwrap()).unwrap();
    assert!(list.objects.len() > 5, "{}", list.objects.len());
    let published = setting.published.lock().unwrap();
    let latest = |wanted| published.iter().rev().find(|(output, _)| *output == wanted).unwrap().1.as_slice();
    let objects: Detection3dArray = from_cdr(latest(Output::Objects)).unwrap();
    assert_eq!(objects.header.frame_id, "map");
    let boxes = list.objects.iter().filter_map(|object| Some((object.id, object.shape.as_ref()?)));
    let with_boxes: Vec<_> = boxes.collect();
    assert!(list.not_counted.iter().any(|object| object.shape.is_some()), "some objects are tentative");
    assert_eq!(objects.detections.len(), with_boxes.len(), "those that count");
    for (detection, (id, shape)) in objects.detections.iter().zip(with_boxes) {
        assert_eq!(detection.id, id.to_string());
        let (center, size) = (&detection.bbox.center.position, &detection.bbox.size);
        assert_eq!([center.x, center.y, center.z], shape.oriented_box.center.to_array());
        assert_eq!([size.x, size.y, size.z], shape.oriented_box.size.as_dvec3().to_array());
    }
    let markers: MarkerArray<'_> = from_cdr(latest(Output::Markers)).unwrap();
    assert_eq!(markers.markers.iter().filter(|marker| marker.action == 0).count(), 2 * objects.detections.len());
    let points: PointCloud2<'_> = from_cdr(latest(Output::Points)).unwrap();
    assert_eq!(points.width as usize, setting.session.pipeline().memory().unwrap().gaussian_count());

    check_places(&saved, &list, (latest(Output::Map), latest(Output::SceneGraph)));

    let ids: Vec<_> = published.iter().filter(|(output, _)| *output == Output::Ids).collect();
    assert_eq!(ids.len(), 4);
    for (_, message) in ids {
        let image: Image<'_> = from_cdr(message).unwrap();
        assert_eq!((image.width, image.height, image.encoding), (320, 240, "16UC1"));
        assert_eq!(image.header.frame_id, "camera_color_optical_frame");
        assert!(image.data.chunks_exact(2).any(|id| id != [0, 0]));
    }
    let diagnostics: DiagnosticArray = from_cdr(latest(Output::Diagnostics)).unwrap();
    assert_eq!(diagnostics.status[0].message, "running");
    assert_eq!(setting.shown.lock().unwrap().last().unwrap().counts.frames, 4);
}

/// Asserts that free space and scene graph are those of the saved map.
fn check_places(saved: &SavedMap, list: &ObjectList, (grid, graph): (&[u8], &[u8])) {
    let map = NamedMap::load(saved.map()).unwrap();
    let plan = map.floor_plan(PlanSettings::default()).unwrap();
    let grid: OccupancyGrid = from_cdr(grid).unwrap();
    assert_eq!((grid.data, grid.info.width as usize), (plan.grid().ros_values(), plan.grid().shape.width));
    assert_eq!(grid.header.frame_id, "map");
    assert_eq!((grid.info.origin.position.x, grid.info.origin.position.y), plan.grid().shape.origin.into());
    let graph: SceneGraph = serde_json::from_str(&from_cdr::<TextMessage>(graph).unwrap().data).unwrap();
    let of_map = map.scene_graph().unwrap();
    assert_eq!((&graph.rooms, &graph.relations), (&of_map.rooms, &of_map.relations));
    assert_eq!(list.rooms.len(), plan.rooms().len());
    assert!(!list.rooms.is_empty() && list.objects.iter().any(|object| object.room.is_some()));
    // When objects were seen, in the list, in the map and in the graph.
    let of_map_list = map.object_list();
    for object in &list.objects {
        let (first, last) = (object.first_seen_s.unwrap(), object.last_seen_s.unwrap());
        assert_eq!(Some(first), object.first_frame.as_ref().unwrap().time_s);
        assert_eq!(Some(last), object.last_frame.as_ref().unwrap().time_s);
        let saved = of_map_list.get(object.id).unwrap();
        assert_eq!((saved.first_seen_s, saved.last_seen_s), (Some(first), Some(last)));
        let in_graph = graph.objects.iter().find(|one| one.id == object.id).unwrap();
        assert_eq!((in_graph.last_seen.time_s, in_graph.room), (Some(last), object.room));
    }
}

/// The ids of each frame that was published, in order.
fn shown_ids(published: &Published) -> Vec<BTreeSet<u32>> {
    let published = published.lock().unwrap();
    let images = published.iter().filter(|(output, _)| *output == Output::Ids);
    let ids = |(_, message): &(Output, Vec<u8>)| {
        let image: Image<'_> = from_cdr(message).unwrap();
        let pixels = image.data.as_chunks::<2>().0.iter().map(|id| u32::from(u16::from_le_bytes(*id)));
        pixels.filter(|id| *id != 0).collect()
    };
    images.map(ids).collect()
}

#[test]
fn with_a_lag_every_frame_is_published_later_on_its_stamp() {
    let run = |lag: Duration| {
        let folder = tempfile::tempdir().unwrap();
        let saved = SavedMap::new(folder.path().join("home.ply"));
        let options = LiveOptions { lag, saved_map: Some(saved.clone()), ..LiveOptions::default() };
        let mut setting = setting(options, None);
        play(&mut setting);
        assert_eq!(setting.session.status().frames, 4);
        let list: ObjectList = serde_json::from_slice(&std::fs::read(saved.objects()).unwrap()).unwrap();
        let shown: BTreeSet<u32> = shown_ids(&setting.published).into_iter().flatten().collect();
        let listed: BTreeSet<u32> = list.all().map(|object| object.id).collect();
        assert!(shown.is_subset(&listed), "{shown:?}, {listed:?}");
        let published = setting.published.lock().unwrap();
        let images = published.iter().filter(|(output, _)| *output == Output::Ids);
        let stamp =
            |(_, message): &(Output, Vec<u8>)| from_cdr::<Image<'_>>(message).unwrap().header.stamp.nanoseconds();
        (images.map(stamp).collect::<Vec<_>>(), list)
    };
    let (stamps, at_once) = run(Duration::ZERO);
    assert!(stamps.len() == 4 && stamps.is_sorted());
    let seen = |list: &ObjectList| -> Vec<_> {
        let mut objects: Vec<_> = list.all().cloned().collect();
        objects.sort_by_key(|object| object.id);
        let seen = |object: Object| {
            let frames = (object.frames, object.first_frame, object.last_frame);
            (object.id, frames, object.confidence, object.best_view)
        };
        objects.into_iter().map(seen).collect()
    };
    for lag in [Duration::from_millis(1), Duration::from_secs(10)] {
        let (late, list) = run(lag);
        assert_eq!(late, stamps);
        assert_eq!(seen(&list), seen(&at_once), "objects are not delayed");
    }
}

/// A method that does not decide frames again.
struct WithoutHindsight(FastSamSplat);

impl Method for WithoutHindsight {
    fn name(&self) -> &str {
        "without-hindsight"
    }

    fn process(&mut self, frame: &RgbdFrame, found: &Segmentation) -> Result<FrameOutput, TrackingError> {
        self.0.process(frame, found)
    }

    fn merge_objects(&mut self, remapped: &[RemappedId]) {
        self.0.merge_objects(remapped);
    }

    fn memory(&self) -> Option<&SplatMemory> {
        self.0.memory()
    }
}

#[test]
fn frames_that_wait_show_objects_that_were_merged_meanwhile_as_one() {
    let build: BuildPipeline = Box::new(|_| {
        let method = FastSamSplat::new(FastSamSplatSettings::default(), 0, &mut |_| {}).unwrap();
        Pipeline::builder(&Settings::default()).method(Box::new(WithoutHindsight(method))).build()
    });
    let lag = Duration::from_secs(10);
    let mut setting = setting_with(build, LiveOptions { lag, ..LiveOptions::default() }, None);
    let (requests, stream) = (setting.session.requests(), Arc::clone(&setting.stream));
    let (mut merged, timeout) = ((0, 0), Duration::from_secs(20));
    std::thread::scope(|scope| {
        let working = scope.spawn(|| {
            feed(&stream);
            // A message of a minute later: frames wait for no other image any more.
            stream.feed_at(("/clock", "std_msgs/msg/String"), &[], Duration::from_secs(1_700_000_060));
            let mut ids = Vec::new();
            for _ in 0..2000 {
                let seen = requests.look(|session| (session.status().frames, session.objects().objects), timeout);
                if let Ok((4, objects)) = seen {
                    // The two that most frames show.
                    ids = objects.iter().map(|object| object.id).take(2).collect();
                    break;
                }
                std::thread::sleep(Duration::from_millis(5));
            }
            let answer = requests.send(LiveRequest::Merge(ids.clone()), timeout);
            // Ends the session before anything here can panic.
            stream.end();
            answer.map(|_| ids)
        });
        setting.session.run(&mut || false).unwrap();
        let ids = working.join().unwrap().unwrap();
        merged = (ids[0].min(ids[1]), ids[0].max(ids[1]));
    });
    let shown = shown_ids(&setting.published);
    assert_eq!(shown.len(), 4);
    assert!(shown[0].contains(&merged.0));
    assert!(shown.iter().all(|ids| !ids.contains(&merged.1)), "{merged:?} {shown:?}");
}

#[test]
fn a_session_goes_on_with_its_saved_map() {
    let folder = tempfile::tempdir().unwrap();
    let saved = SavedMap::new(folder.path().join("home.ply"));
    let options = LiveOptions { saved_map: Some(saved.clone()), ..LiveOptions::default() };
    let mut first = setting(options.clone(), None);
    play(&mut first);
    let before = first.session.objects().all().count();
    let mut second = setting(options, Some(saved.map()));
    play(&mut second);
    let after = second.session.objects().all().count();
    // The same four frames show little that is new.
    assert!(after <= before + 3, "{before} objects, then {after}");
}

#[test]
fn requests_are_answered_between_frames() {
    let folder = tempfile::tempdir().unwrap();
    let saved = SavedMap::new(folder.path().join("home.ply"));
    let mut setting = setting(LiveOptions { saved_map: Some(saved.clone()), ..LiveOptions::default() }, None);
    let (requests, stream) = (setting.session.requests(), Arc::clone(&setting.stream));
    let is_done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let send = |request| requests.send(request, Duration::from_secs(20));
            let answers = [send(LiveRequest::Load(None)), {
                feed(&stream);
                send(LiveRequest::Save)
            }];
            let later =
                [LiveRequest::Pause(true), LiveRequest::Pause(false), LiveRequest::Reset, LiveRequest::Load(None)];
            let later = later.map(send);
            // Ends the session before anything here can panic.
            is_done.store(true, Ordering::SeqCst);
            let missing = answers[0].clone().unwrap_err();
            assert!(missing.contains("home.ply"), "{missing}");
            assert!(answers[1].clone().unwrap().contains("home.ply"));
            let [paused, running, reset, loaded] = later.map(Result::unwrap);
            assert_eq!([paused, running, reset], ["paused", "running", "forgot everything"]);
            assert!(loaded.contains("home.ply"));
        });
        setting.session.run(&mut || is_done.load(Ordering::SeqCst)).unwrap();
    });
    assert!(saved.map().exists());
}

#[test]
fn the_detail_that_a_viewer_has_chosen_stays_after_a_reset() {
    let objects = |detail: Detail| {
        let mut setting = setting(LiveOptions::default(), None);
        let requests = setting.session.requests();
        let is_done = AtomicBool::new(false);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let send = |request| requests.send(request, Duration::from_secs(20));
                let answers = [LiveRequest::Detail(detail), LiveRequest::Reset].map(send);
                is_done.store(true, Ordering::SeqCst);
                assert!(answers.iter().all(Result::is_ok), "{answers:?}");
            });
            setting.session.run(&mut || is_done.load(Ordering::SeqCst)).unwrap();
        });
        play(&mut setting);
        setting.session.objects().all().count()
    };
    let (coarse, fine) = (objects(Detail::Coarse), objects(Detail::Fine));
    assert!(coarse < fine, "{coarse} objects, and {fine} with more detail");
}

/// Who drives by the grid must not see walls of a map that was replaced.
#[test]
fn after_a_reset_the_plan_of_the_map_before_is_withdrawn() {
    let mut setting = setting(LiveOptions::default(), None);
    play(&mut setting);
    let (requests, published) = (setting.session.requests(), Arc::clone(&setting.published));
    let position = published.lock().unwrap().len();
    let before = published.lock().unwrap().iter().rev().find(|(output, _)| *output == Output::Map).unwrap().1.clone();
    let before: OccupancyGrid = from_cdr(&before).unwrap();
    assert!(before.data.contains(&0) && before.data.contains(&100));
    // Requests are carried out even when the frames have ended.
    let is_done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let answer = requests.send(LiveRequest::Reset, Duration::from_secs(20));
            is_done.store(true, Ordering::SeqCst);
            answer.unwrap();
        });
        while !is_done.load(Ordering::SeqCst) {
            setting.session.run(&mut || false).unwrap();
        }
    });
    let published = published.lock().unwrap();
    let after = |wanted| published[position..].iter().find(|(output, _)| *output == wanted).unwrap().1.as_slice();
    let grid: OccupancyGrid = from_cdr(after(Output::Map)).unwrap();
    assert_eq!((grid.data, grid.info.origin), (vec![-1; before.data.len()], before.info.origin));
    let graph: TextMessage = from_cdr(after(Output::SceneGraph)).unwrap();
    let graph: SceneGraph = serde_json::from_str(&graph.data).unwrap();
    assert_eq!(graph.objects.len(), 0);
}

/// A message to a page: a list of objects with the number of frames, a version of the map and whether it is known where up
/// is, a merge, or a reset.
#[derive(Clone, Debug, PartialEq)]
enum Shown {
    Objects(Vec<u32>, usize),
    Map(usize, bool),
    LastMap(usize),
    /// Ids, each with the one that it was merged into.
    Merged(Vec<(u32, u32)>),
    Reset,
}

/// An outlet that watches and wants no messages.
struct Watcher {
    shown: Arc<Mutex<Vec<Shown>>>,
    /// Delays of the frames that were shown, and their numbers.
    delays: Arc<Mutex<Vec<(usize, Duration)>>>,
}

impl Watcher {
    fn show(&self, shown: Shown) {
        self.shown.lock().unwrap().push(shown);
    }
}

impl Outlet for Watcher {
    fn wants(&self, _: Output) -> bool {
        false
    }

    fn publish(&mut self, _: Output, _: Vec<u8>) {}

    fn show(&mut self, _: &LiveStatus) {}

    fn is_watched(&self) -> bool {
        true
    }

    fn show_frame(&mut self, frame: &LiveFrame<'_>) {
        self.delays.lock().unwrap().push((frame.number, frame.delay));
    }

    fn show_objects(&mut self, objects: &ObjectList, frames: usize) {
        Watcher::show(self, Shown::Objects(objects.all().map(|object| object.id).collect(), frames));
    }

    fn show_map(&mut self, _: &MapView<'_>, up: Option<Vec3>, version: usize) {
        Watcher::show(self, Shown::Map(version, up.is_some()));
    }

    fn show_last_map(&mut self, _: &MapView<'_>, _: Option<Vec3>, version: usize) {
        Watcher::show(self, Shown::LastMap(version));
    }

    fn merge(&mut self, merged: &[RemappedId]) {
        Watcher::show(self, Shown::Merged(merged.iter().map(|ids| (ids.from, ids.into)).collect()));
    }

    fn reset(&mut self) {
        Watcher::show(self, Shown::Reset);
    }
}

/// A session with a stream, which a [`Watcher`] watches.
fn watched(stream: LiveStream, options: LiveOptions, load: Option<&Path>) -> (Setting, Watcher) {
    let stream = Arc::new(stream);
    let watcher = Watcher { shown: Arc::default(), delays: Arc::default() };
    let (shown, delays) = (Arc::clone(&watcher.shown), Arc::clone(&watcher.delays));
    let settings: Settings = SettingsLayers::default().resolve().unwrap();
    let build: BuildPipeline = Box::new(move |map| match map {
        Some(map) => Pipeline::builder(&settings).saved_memory(map).build(),
        None => Pipeline::builder(&settings).build(),
    });
    let ends: (_, Box<dyn Outlet>) = (Arc::clone(&stream), Box::new(watcher));
    let session = LiveSession::new(build, load, ends, options).unwrap();
    (Setting { stream, published: Arc::default(), shown: Arc::default(), session }, Watcher { shown, delays })
}

fn without_drops() -> LiveStream {
    let mut dataset = DatasetSettings::default();
    dataset.world_frame = Some("map".to_owned());
    LiveStream::without_drops(&dataset).unwrap()
}

#[test]
fn the_page_gets_objects_and_map_of_the_end_without_a_frame_and_learns_of_a_reset() {
    let folder = tempfile::tempdir().unwrap();
    let saved = SavedMap::new(folder.path().join("home.ply"));
    let options = LiveOptions { saved_map: Some(saved.clone()), ..LiveOptions::default() };
    let (mut setting, watcher) = watched(without_drops(), options, None);
    play(&mut setting);
    let ids: Vec<u32> = setting.session.objects().all().map(|object| object.id).collect();
    let shown = std::mem::take(&mut *watcher.shown.lock().unwrap());
    let [objects, Shown::LastMap(last)] = &shown[shown.len() - 2..] else { panic!("{shown:?}") };
    assert_eq!(objects, &Shown::Objects(ids.clone(), 4), "the last list is that of the end");
    assert!(shown.iter().all(|shown| !matches!(shown, Shown::Map(version, _) if version >= last)), "{shown:?}");

    // The page learns of merges by hand, too.
    let list = setting.session.objects().objects;
    let in_map: Vec<u32> = list.iter().filter(|object| object.shape.is_some()).map(|object| object.id).collect();
    let (into, from) = (in_map[0].min(in_map[1]), in_map[0].max(in_map[1]));
    setting.session.merge_objects(&[from, into]).unwrap();
    assert_eq!(watcher.shown.lock().unwrap()[0], Shown::Merged(vec![(from, into)]));

    // A loaded map is shown before the first frame.
    let (mut setting, watcher) = watched(without_drops(), LiveOptions::default(), Some(saved.map()));
    let (requests, is_done) = (setting.session.requests(), AtomicBool::new(false));
    std::thread::scope(|scope| {
        scope.spawn(|| {
            std::thread::sleep(Duration::from_millis(700));
            let answer = requests.send(LiveRequest::Reset, Duration::from_secs(20));
            is_done.store(true, Ordering::SeqCst);
            answer.unwrap();
        });
        setting.session.run(&mut || is_done.load(Ordering::SeqCst)).unwrap();
    });
    let shown = watcher.shown.lock().unwrap();
    let counted = |list: &[Shown]| match list.iter().find(|shown| matches!(shown, Shown::Objects(..))) {
        Some(Shown::Objects(ids, frames)) => (ids.len(), *frames),
        _ => panic!("{list:?}"),
    };
    let reset = shown.iter().position(|shown| *shown == Shown::Reset).unwrap();
    let (before, after) = shown.split_at(reset);
    assert!(counted(before).0 > 5 && before.contains(&Shown::Map(0, true)), "{before:?}");
    assert_eq!(counted(after), (0, 0), "{after:?}");
}

#[test]
fn with_a_lag_the_delay_of_a_frame_is_that_of_its_showing() {
    let mut dataset = DatasetSettings::default();
    dataset.world_frame = Some("map".to_owned());
    let limits = MatchLimits { settle: Duration::ZERO, ..MatchLimits::default() };
    let options = LiveOptions { lag: Duration::from_secs(10), ..LiveOptions::default() };
    let (mut setting, watcher) = watched(LiveStream::new(&dataset, limits).unwrap(), options, None);
    let stream = Arc::clone(&setting.stream);
    read_messages(&recording(), &mut |message| {
        stream.feed(message.topic, message.type_name, message.data);
        Ok(())
    })
    .unwrap();
    let started = std::time::Instant::now();
    // The lag keeps the frames until the end.
    setting.session.run(&mut || started.elapsed() > Duration::from_secs(2)).unwrap();
    let delays = watcher.delays.lock().unwrap();
    assert!(!delays.is_empty() && delays.iter().all(|(_, delay)| *delay > Duration::from_secs(2)), "{delays:?}");
    // The one that was used is not dropped; each of the others had two images.
    let status = setting.session.status();
    assert_eq!((status.dropped_frames + status.frames as u64, status.counts.dropped.unpaired), (4, 0), "{status:?}");
}

#[test]
fn requests_without_end_do_not_stop_the_frames_nor_the_end() {
    let mut setting = setting(LiveOptions::default(), None);
    let (requests, is_done, is_stopped) = (setting.session.requests(), AtomicBool::new(false), AtomicBool::new(false));
    std::thread::scope(|scope| {
        for _ in 0..16 {
            scope.spawn(|| {
                while !is_done.load(Ordering::SeqCst) {
                    // A slow one, so that the others are always faster.
                    let _ = requests.look(|_| std::thread::sleep(Duration::from_millis(5)), Duration::from_secs(20));
                }
            });
        }
        scope.spawn(|| {
            std::thread::sleep(Duration::from_secs(1));
            is_stopped.store(true, Ordering::SeqCst);
            // Otherwise the test would go on for ever.
            let stopped = std::time::Instant::now();
            while !is_done.load(Ordering::SeqCst) && stopped.elapsed() < Duration::from_secs(3) {
                std::thread::sleep(Duration::from_millis(5));
            }
            is_done.store(true, Ordering::SeqCst);
        });
        let started = std::time::Instant::now();
        setting.session.run(&mut || is_stopped.load(Ordering::SeqCst)).unwrap();
        assert!(started.elapsed() < Duration::from_secs(3), "{:?}", started.elapsed());
        is_done.store(true, Ordering::SeqCst);
        setting.session.close_requests();
    });
}

#[test]
fn once_requests_are_closed_nobody_waits_for_an_answer() {
    let mut setting = setting(LiveOptions::default(), None);
    let requests = setting.session.requests();
    std::thread::scope(|scope| {
        let started = std::time::Instant::now();
        let waiting = scope.spawn(|| requests.send(LiveRequest::Save, Duration::from_secs(20)));
        std::thread::sleep(Duration::from_millis(300));
        setting.session.close_requests();
        let answers = [waiting.join().unwrap(), requests.send(LiveRequest::Reset, Duration::from_secs(20))];
        assert_eq!(answers, ["the session has ended"; 2].map(|error| Err(error.to_owned())));
        assert!(started.elapsed() < Duration::from_secs(10), "{:?}", started.elapsed());
    });
}

#[test]
fn the_reason_why_a_frame_cannot_be_used_stays_until_one_can() {
    let limits = MatchLimits { settle: Duration::ZERO, ..MatchLimits::default() };
    let mut dataset = DatasetSettings::default();
    dataset.world_frame = Some("map".to_owned());
    let (mut setting, _) = watched(LiveStream::new(&dataset, limits).unwrap(), LiveOptions::default(), None);
    let stream = Arc::clone(&setting.stream);
    read_messages(&recording(), &mut |message| {
        // The ends of images are zeros, so that no frame can be read.
        let mut data = message.data.to_vec();
        if message.type_name.ends_with("CompressedImage") {
            let end = data.len();
            data[end - 200..].fill(0);
        }
        stream.feed(message.topic, message.type_name, &data);
        Ok(())
    })
    .unwrap();
    let started = std::time::Instant::now();
    setting.session.run(&mut || started.elapsed() > Duration::from_secs(1)).unwrap();
    let status = setting.session.status();
    assert!(status.skipped > 0 && status.frames == 0, "{status:?}");
    assert!(status.problem.is_some(), "{status:?}");
}

#[test]
fn bytes_that_are_no_messages_are_counted() {
    let setting = setting(LiveOptions::default(), None);
    for (topic, type_name) in [("/a", "sensor_msgs/msg/Image"), ("", ""), ("/tf", "tf2_msgs/msg/TFMessage")] {
        setting.stream.feed(topic, type_name, &[0xff; 40]);
    }
    assert_eq!(setting.stream.counts().messages, 3);
    assert!(setting.stream.wait(Duration::from_millis(1)).is_none());
}

#[test]
fn a_recording_of_what_was_used_gives_the_same_map() {
    let folder = tempfile::tempdir().unwrap();
    let [live, replayed] = ["live.ply", "replayed.ply"].map(|name| SavedMap::new(folder.path().join(name)));
    let (used, mut dataset) = (folder.path().join("used.mcap"), DatasetSettings::default());
    dataset.world_frame = Some("map".to_owned());
    let run = |stream: LiveStream, file: &Path, saved: &SavedMap, record: Option<&Path>| {
        let stream = Arc::new(stream);
        if let Some(path) = record {
            stream.record(path).unwrap();
        }
        let settings: Settings = SettingsLayers::default().resolve().unwrap();
        let build: BuildPipeline = Box::new(move |_| Pipeline::builder(&settings).build());
        let options = LiveOptions { saved_map: Some(saved.clone()), ..LiveOptions::default() };
        let ends: (_, Box<dyn Outlet>) = (Arc::clone(&stream), Box::new(splatseg_live::Silent));
        let mut session = LiveSession::new(build, None, ends, options).unwrap();
        let feed = || {
            read_messages(file, &mut |message| {
                stream.feed_at((message.topic, message.type_name), message.data, message.recorded);
                Ok(())
            })
            .unwrap();
            stream.end();
        };
        std::thread::scope(|scope| {
            if record.is_some() {
                // Before the session looks, so that frames are dropped.
                feed();
            } else {
                scope.spawn(feed);
            }
            session.run(&mut || false).unwrap();
        });
        stream.finish_recording().unwrap();
        session.status().frames
    };
    let limits = MatchLimits { complete: 2, pose_wait: Duration::from_secs(5), ..MatchLimits::default() };
    let frames = run(LiveStream::new(&dataset, limits).unwrap(), &recording(), &live, Some(&used));
    assert_eq!(frames, 2, "the newest of four frames");
    assert_eq!(run(LiveStream::without_drops(&dataset).unwrap(), &used, &replayed, None), 2);
    let bytes = |saved: &SavedMap| std::fs::read(saved.map()).unwrap();
    assert!(bytes(&live) == bytes(&replayed));
}

/// The messages of `/diagnostics`, in order.
fn diagnoses(published: &Published) -> Vec<String> {
    let published = published.lock().unwrap();
    let diagnostics = published.iter().filter(|(output, _)| *output == Output::Diagnostics);
    diagnostics.map(|(_, bytes)| from_cdr::<DiagnosticArray>(bytes).unwrap().status[0].message.clone()).collect()
}

#[test]
fn a_map_that_cannot_be_saved_is_said_until_it_can() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().join("disk");
    let saved = SavedMap::new(place.join("home.ply"));
    let (save_interval, status_interval) = (Duration::from_millis(1), Duration::ZERO);
    let options = LiveOptions { saved_map: Some(saved.clone()), save_interval, status_interval, ..Default::default() };
    let mut setting = setting(options, None);
    let (stream, shown) = (Arc::clone(&setting.stream), Arc::clone(&setting.shown));
    // A message at a time: the folder appears once a save has failed, before the last frames.
    let problem_is = |is_wanted: bool| {
        let latest = shown.lock().unwrap().last().and_then(|status| status.saving.clone());
        latest.is_some_and(|saving| saving.problem.is_some() == is_wanted)
    };
    std::thread::scope(|scope| {
        scope.spawn(|| {
            read_messages(&recording(), &mut |message| {
                stream.feed_at((message.topic, message.type_name), message.data, message.recorded);
                if problem_is(true) && !place.exists() {
                    std::fs::create_dir(&place).unwrap();
                }
                Ok(())
            })
            .unwrap();
            stream.end();
        });
        // The recording is short: most frames come when the stream ends. Then the first save fails.
        let ended = setting.session.run(&mut || false);
        assert_eq!(ended.is_err(), !place.exists(), "{ended:?}");
    });
    let unsaved = |message: &String| message.starts_with("the map is not saved: ") && message.contains("home.ply");
    let messages = diagnoses(&setting.published);
    assert!(messages.iter().any(unsaved), "{messages:?}");
    if !place.exists() {
        assert!(unsaved(messages.last().unwrap()), "{messages:?}");
        assert!(problem_is(true) && setting.session.status().saving.as_ref().unwrap().saved_frames.is_none());
        std::fs::create_dir(&place).unwrap();
    }
    // What was not saved is saved at the end of the next part.
    setting.session.run(&mut || true).unwrap();
    assert!(saved.exists());
    let status = setting.session.status();
    assert_eq!((status.frames, status.saving.as_ref().unwrap().saved_frames), (4, Some(4)));
    let messages = diagnoses(&setting.published);
    assert!(!unsaved(messages.last().unwrap()), "{messages:?}");
    // What somebody removes is saved again.
    std::fs::remove_file(saved.objects()).unwrap();
    setting.session.run(&mut || true).unwrap();
    assert!(saved.exists());
}

#[test]
fn a_label_given_to_an_object_is_found_published_and_saved() {
    let folder = tempfile::tempdir().unwrap();
    let saved = SavedMap::new(folder.path().join("home.ply"));
    let mut setting = setting(LiveOptions { saved_map: Some(saved.clone()), ..LiveOptions::default() }, None);
    play(&mut setting);
    let object = setting.session.objects().objects.into_iter().find(|object| object.shape.is_some()).unwrap();
    setting.session.name_by_hand(object.id, Some("mug")).unwrap();
    assert!(setting.session.name_by_hand(9999, Some("mug")).unwrap_err().contains("no object 9999"));
    assert!(setting.session.name_by_hand(object.id, Some("a\nb")).is_err());
    let words = setting.session.words();
    let found = words.find("coffee cup").unwrap();
    assert_eq!(found.iter().map(|found| (found.id, found.score)).collect::<Vec<_>>(), [(object.id, 1.0)]);
    let message = words.detections(&found);
    assert_eq!((message.header.frame_id.as_str(), message.detections.len()), ("map", 1));
    assert_eq!(message.detections[0].results[0].hypothesis.class_id, "mug");
    assert!(words.find("piano").unwrap().is_empty());
    {
        let published = setting.published.lock().unwrap();
        let (_, latest) = published.iter().rev().find(|(output, _)| *output == Output::Objects).unwrap();
        let objects: Detection3dArray = from_cdr(latest).unwrap();
        let classes = objects.detections.iter().map(|detection| detection.results[0].hypothesis.class_id.as_str());
        assert_eq!(classes.filter(|class| *class == "mug").count(), 1);
    }
    // No frame has come since the last save, but a name.
    setting.session.run(&mut || true).unwrap();
    let list: ObjectList = serde_json::from_slice(&std::fs::read(saved.objects()).unwrap()).unwrap();
    let labelled = list.objects.iter().find(|other| other.label.is_some()).unwrap();
    assert_eq!((labelled.id, labelled.label.as_deref()), (object.id, Some("mug")));
}

#[test]
fn objects_that_are_merged_are_one_in_messages_and_in_the_saved_map() {
    let folder = tempfile::tempdir().unwrap();
    let saved = SavedMap::new(folder.path().join("home.ply"));
    let mut setting = setting(LiveOptions { saved_map: Some(saved.clone()), ..LiveOptions::default() }, None);
    play(&mut setting);
    let in_map = |list: ObjectList| -> Vec<u32> {
        list.objects.iter().filter(|object| object.shape.is_some()).map(|object| object.id).collect()
    };
    let ids = in_map(setting.session.objects());
    let (into, from) = (ids[0].min(ids[1]), ids[0].max(ids[1]));
    setting.session.name_by_hand(from, Some("mug")).unwrap();
    let frames = |session: &LiveSession, id: u32| session.objects().get(id).map_or(0, |object| object.frames);
    let most = frames(&setting.session, into).max(frames(&setting.session, from));
    for wrong in [&[into, 9999][..], &[into, into]] {
        setting.session.merge_objects(wrong).unwrap_err();
    }
    assert_eq!(in_map(setting.session.objects()), ids, "nothing has changed");
    assert_eq!(setting.session.merge_objects(&[from, into]), Ok(into));
    assert!(frames(&setting.session, into) >= most);
    {
        let published = setting.published.lock().unwrap();
        let (_, latest) = published.iter().rev().find(|(output, _)| *output == Output::Objects).unwrap();
        let objects: Detection3dArray = from_cdr(latest).unwrap();
        assert!(objects.detections.iter().all(|detection| detection.id != from.to_string()));
    }
    // No frame has come since the last save, but a merge.
    setting.session.run(&mut || true).unwrap();
    let again = self::setting(LiveOptions::default(), Some(saved.map())).session.objects();
    assert!(again.get(from).is_none() && again.get(into).unwrap().label.as_deref() == Some("mug"));
}

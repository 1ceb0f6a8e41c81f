//! A memory on a device beside the same memory on the CPU, frame by frame.

use splatseg_dataset::{DatasetSettings, FrameStream, GroundTruth, StreamedFrame, open_scene};
use splatseg_geometry::{Image, SegmentId, SegmentMap};
use splatseg_memory::{
    ABSTAIN, FrameUpdate, GrowthRule, MemoryKind, MemorySettings, SplatContent, SplatFile, SplatMemory,
};
use splatseg_render_gpu::{GpuDevice, GpuError};
use std::sync::{LazyLock, OnceLock};

/// Ids that the synthetic room has at most.
const IDS: SegmentId = 40;

/// The device of the tests; without one, they say that they are skipped.
fn device() -> Option<GpuDevice> {
    static DEVICE: OnceLock<Result<GpuDevice, GpuError>> = OnceLock::new();
    match DEVICE.get_or_init(GpuDevice::open) {
        Ok(device) => Some(device.clone()),
        Err(error) => {
            // Not `println!`, whose output the test runner hides when a test passes.
            let test = std::thread::current().name().unwrap_or("a test of the GPU").to_owned();
            let line = format!("\nskipped: {test}: {error}\n");
            let _ = std::io::Write::write_all(&mut std::io::stderr(), line.as_bytes());
            None
        }
    }
}

/// A room in which things move, so that Gaussians are removed.
static ROOM: LazyLock<Vec<StreamedFrame>> = LazyLock::new(|| {
    let settings = DatasetSettings::default();
    let scene = open_scene("synthetic:frames=14,width=150,height=110,moving=3", &settings).unwrap();
    FrameStream::open(scene, &settings, GroundTruth::Read).unwrap().map(Result::unwrap).collect()
});

fn memory(settings: MemorySettings) -> SplatMemory {
    SplatMemory::new(settings, 0, &mut |_| {}).unwrap()
}

/// What a frame is seen as: the truth, with errors that change from frame to frame, some of it without a say.
fn seen_in(frame: &StreamedFrame, number: usize) -> SegmentMap {
    let truth = frame.ground_truth.as_ref().unwrap();
    SegmentMap::from_fn(truth.width(), truth.height(), |column, row| match (column / 9 + row / 7 + number) % 11 {
        0 => 0,
        1 => ABSTAIN,
        2 => (truth[(column, row)] + 1) % IDS,
        _ => truth[(column, row)],
    })
}

/// What one side found in a frame.
struct Found {
    expected: SegmentMap,
    fused: [SegmentMap; 2],
    confidence: Image<f32>,
    silhouette: Image<f32>,
    depth: Image<f32>,
    recurring: Vec<SegmentId>,
    update: FrameUpdate,
}

fn take_in(memory: &mut SplatMemory, frame: &StreamedFrame, number: usize) -> Found {
    while memory.segment_count() < IDS as usize {
        memory.new_segment().unwrap();
    }
    let seen = seen_in(frame, number);
    let recall = memory.recall(&frame.frame);
    let nothing = seen.map(|_| 0);
    let fused = [memory.fuse(&recall, &seen).unwrap(), memory.fuse(&recall, &nothing).unwrap()];
    // Half of one thing comes again and again.
    let explained = seen.map(|id| if *id == 8 || *id == 3 { 39 } else { 0 });
    let recurring = memory.note_explained(&recall, &explained, &|_, times| times >= 4).unwrap();
    let (expected, confidence) = (recall.expected().segments.clone(), recall.expected().confidence.clone());
    let (silhouette, depth) = (recall.silhouette().clone(), recall.depth().clone());
    let update = memory.update(recall, &seen).unwrap();
    Found { expected, fused, confidence, silhouette, depth, recurring, update }
}

/// At most one pixel of a thousand may differ, and by roundings only where numbers are compared.
fn assert_maps_agree(one: &SegmentMap, other: &SegmentMap, what: &str) {
    let differ = one.pixels().iter().zip(other.pixels()).filter(|(one, other)| one != other).count();
    assert!(1000 * differ <= one.pixels().len(), "{what}: {differ} of {} pixels differ", one.pixels().len());
}

/// At most so many pixels of a thousand may differ by more than `near`.
fn assert_images_agree(one: &Image<f32>, other: &Image<f32>, (near, per_thousand): (f32, usize), what: &str) {
    let differ = one.pixels().iter().zip(other.pixels()).filter(|(one, other)| (*one - *other).abs() > near).count();
    let all = one.pixels().len();
    assert!(1000 * differ <= per_thousand * all, "{what}: {differ} of {all} pixels differ");
}

/// Numbers that must be the same but for what roundings decide.
fn assert_about(one: usize, other: usize, what: &str) {
    assert!(one.abs_diff(other) <= 2 + one / 200, "{what}: {one} and {other}");
}

/// Runs both sides over the room; returns them.
fn compare(settings: &MemorySettings, device: &GpuDevice) -> [SplatMemory; 2] {
    let mut host = memory(settings.clone());
    let mut gpu = memory(settings.clone()).on_device(device).unwrap();
    let (mut removed, mut recurred) = (0, 0);
    for (number, frame) in ROOM.iter().enumerate() {
        let (one, other) = (take_in(&mut host, frame, number), take_in(&mut gpu, frame, number));
        assert_maps_agree(&one.expected, &other.expected, "expected");
        assert_maps_agree(&one.fused[0], &other.fused[0], "fused");
        assert_maps_agree(&one.fused[1], &other.fused[1], "fused with nothing");
        // Gradient descent amplifies roundings where the map covers little: two runs on the CPU whose learning rates are
        // 5e-8 apart differ by more than 1e-2 in 45 of 16,500 pixels of such a room.
        let near = if settings.kind == MemoryKind::Features { (1e-2, 3) } else { (1e-4, 1) };
        assert_images_agree(&one.confidence, &other.confidence, near, "confidence");
        assert_images_agree(&one.silhouette, &other.silhouette, (1e-4, 1), "silhouette");
        assert_images_agree(&one.depth, &other.depth, (1e-4, 1), "depth");
        assert_eq!(one.recurring, other.recurring, "frame {number}");
        assert_eq!(one.update.forgotten, other.update.forgotten, "frame {number}");
        assert_about(one.update.grown, other.update.grown, "grown");
        assert_about(one.update.removed, other.update.removed, "removed");
        let active = |found: &Found| found.update.learning.active_gaussians;
        assert_about(active(&one), active(&other), "active");
        (removed, recurred) = (removed + one.update.removed, recurred + one.recurring.len());
    }
    let removes = settings.removal_frames > 0 && settings.growth_rule() == GrowthRule::Missing;
    assert!(removed > 0 || !removes, "nothing was removed");
    // The paper's memory does not ask which Gaussians a frame sees, so nothing can recur in their places.
    let asks = settings.kind == MemoryKind::Evidence || settings.growth_rule() == GrowthRule::Missing;
    assert!(recurred > 0 || !asks, "nothing recurred");
    [host, gpu]
}

/// Compares all that two memories hold, as files.
fn assert_contents_agree(host: &SplatMemory, gpu: &SplatMemory) {
    assert_about(host.gaussian_count(), gpu.gaussian_count(), "Gaussians");
    assert_eq!(host.carried_ids(), gpu.carried_ids());
    assert_eq!(host.parameter_count(), gpu.parameter_count());
    let same = |one: &[u32], other: &[u32]| one.iter().zip(other).filter(|(one, other)| one == other).count();
    assert_about(same(&host.segment_ids(), &gpu.segment_ids()), host.gaussian_count(), "segments of Gaussians");
    let shares = host.segment_shares().into_iter().zip(gpu.segment_shares());
    assert_about(shares.filter(|(one, other)| (one - other).abs() > 1e-3).count(), 0, "shares");
    let means = host.balls().means.iter().zip(&gpu.balls().means);
    assert_about(means.filter(|(one, other)| one.distance(**other) > 1e-4).count(), 0, "means");
    let radii = host.balls().radii.iter().zip(&gpu.balls().radii);
    assert_about(radii.filter(|(one, other)| (*one - *other).abs() > 1e-5).count(), 0, "radii");
    let colors = host.colors().iter().zip(gpu.colors());
    assert_about(colors.filter(|(one, other)| one != other).count(), 0, "colours");
}

#[test]
fn both_sides_agree_frame_by_frame() {
    let Some(device) = device() else { return };
    let [host, gpu] = compare(&MemorySettings::default(), &device);
    assert_contents_agree(&host, &gpu);
}

#[test]
fn both_sides_agree_with_other_rules() {
    let Some(device) = device() else { return };
    let fine = MemorySettings::default().with(|settings| {
        (settings.growth_spacing, settings.max_votes, settings.removal_frames) = (2, 2.0, 0);
        (settings.min_alpha, settings.min_transmittance) = (1.0 / 255.0, 1e-4);
    });
    let paper = MemorySettings::default().with(|settings| {
        (settings.growth, settings.removal_frames) = (GrowthRule::Paper, 0);
    });
    for settings in [fine, paper] {
        let [host, gpu] = compare(&settings, &device);
        assert_contents_agree(&host, &gpu);
    }
}

#[test]
fn a_full_map_loses_what_was_not_seen_for_longest() {
    let Some(device) = device() else { return };
    let settings = MemorySettings::default().with(|settings| settings.max_gaussians = 2500);
    let [host, gpu] = compare(&settings, &device);
    assert_eq!((host.gaussian_count(), gpu.gaussian_count()), (2344, 2344));
    assert_contents_agree(&host, &gpu);
}

#[test]
fn a_saved_memory_is_the_same_and_goes_on_on_either_side() {
    let Some(device) = device() else { return };
    save_and_go_on(&MemorySettings::default(), &device);
    save_and_go_on(&features(), &device);
}

/// Compares what is remembered of segments, but for roundings.
fn assert_remembered_agree(one: &SplatContent, other: &SplatContent) {
    match (one, other) {
        (SplatContent::Evidence { votes: one }, SplatContent::Evidence { votes: other }) => {
            assert_about(one.len(), other.len(), "votes");
        }
        (
            SplatContent::Features { features: one, codebook },
            SplatContent::Features { features: other, codebook: other_codebook },
        ) => {
            assert!(codebook == other_codebook);
            let apart = one.iter().zip(other).filter(|(one, other)| (*one - *other).abs() > 1e-3).count();
            assert!(1000 * apart <= one.len(), "{apart} of {} values differ", one.len());
        }
        _ => panic!("two kinds"),
    }
}

fn save_and_go_on(settings: &MemorySettings, device: &GpuDevice) {
    let [mut host, mut gpu] = [None, Some(device)].map(|device| {
        let memory = memory(settings.clone());
        let mut memory = match device {
            Some(device) => memory.on_device(device).unwrap(),
            None => memory,
        };
        ROOM.iter().take(6).enumerate().for_each(|(number, frame)| _ = take_in(&mut memory, frame, number));
        memory
    });
    let folder = tempfile::tempdir().unwrap();
    let paths = ["host.ply", "device.ply"].map(|name| folder.path().join(name));
    host.save(&paths[0]).unwrap();
    gpu.save(&paths[1]).unwrap();
    let [one, other] = [0, 1].map(|side: usize| SplatFile::load(&paths[side]).unwrap());
    let same = |one: &[u32], other: &[u32]| one.iter().zip(other).filter(|(one, other)| one == other).count();
    assert_about(same(&one.map.last_seen, &other.map.last_seen), one.map.last_seen.len(), "last seen");
    let through = one.map.seen_through.iter().zip(&other.map.seen_through);
    assert_about(through.filter(|(one, other)| one != other).count(), 0, "seen through");
    assert_eq!(
        (one.ids, one.sightings, one.carried, one.frames),
        (other.ids, other.sightings, other.carried, other.frames)
    );
    assert_remembered_agree(&one.content, &other.content);
    // What the CPU saved goes on on the device.
    let mut again = SplatMemory::load(&paths[0], settings.clone()).unwrap().on_device(device).unwrap();
    for (number, frame) in ROOM.iter().enumerate().skip(6) {
        let [one, other, third] = [&mut host, &mut gpu, &mut again].map(|memory| take_in(memory, frame, number));
        assert_maps_agree(&one.expected, &other.expected, "expected");
        assert_maps_agree(&one.expected, &third.expected, "expected by the loaded one");
        assert_about(one.update.removed, third.update.removed, "removed by the loaded one");
    }
}

#[test]
fn few_and_small_things_are_transferred() {
    let Some(device) = device() else { return };
    for settings in [MemorySettings::default(), features()] {
        check_transfers(settings, &device);
    }
}

fn check_transfers(settings: MemorySettings, device: &GpuDevice) {
    // A device of its own: other tests transfer, too.
    let device = device.fresh_counters();
    let mut memory = memory(settings).on_device(&device).unwrap();
    for (number, frame) in ROOM.iter().enumerate() {
        let before = device.transfers();
        let found = take_in(&mut memory, frame, number);
        let after = device.transfers();
        let pixel_bytes = 4 * frame.frame.width() as u64 * frame.frame.height() as u64;
        let (uploads, downloads) = (after.uploads - before.uploads, after.downloads - before.downloads);
        assert!(uploads <= 7 && downloads <= 7, "{uploads} uploads and {downloads} downloads in frame {number}");
        // Up go depth, colour, three maps of predictions, and the ids. Down come four images and two maps, and where each Gaussian
        // is seen; a bit for each that may have been removed, and a word for each id.
        let up = after.uploaded_bytes - before.uploaded_bytes;
        assert!(up <= 5 * pixel_bytes + 4096, "{up} bytes up in frame {number}");
        let gaussian_bytes = 5 * (memory.gaussian_count() + found.update.removed) as u64;
        let down = after.downloaded_bytes - before.downloaded_bytes;
        assert!(down <= 6 * pixel_bytes + gaussian_bytes + 4096, "{down} bytes down in frame {number}");
    }
}

#[test]
fn a_view_of_the_cpu_is_refused() {
    let Some(device) = device() else { return };
    let (host, gpu) =
        (memory(MemorySettings::default()), memory(MemorySettings::default()).on_device(&device).unwrap());
    let frame = &ROOM[0].frame;
    let nothing = SegmentMap::filled(frame.width(), frame.height(), 0);
    let error = gpu.fuse(&host.recall(frame), &nothing).unwrap_err();
    assert_eq!(error.to_string(), "the map's device: the view of this frame was not made on this device");
    assert_eq!(gpu.fuse(&gpu.recall(frame), &nothing).unwrap(), nothing);
}

/// Settings of a memory of features with few and short codes, which take little time.
fn features() -> MemorySettings {
    MemorySettings::default().with(|settings| {
        (settings.kind, settings.num_codes, settings.feature_dim) = (MemoryKind::Features, 32, 12);
    })
}

#[test]
fn features_agree_frame_by_frame() {
    let Some(device) = device() else { return };
    let [host, gpu] = compare(&features(), &device);
    assert_contents_agree(&host, &gpu);
}

#[test]
fn features_agree_with_other_rules() {
    let Some(device) = device() else { return };
    let mixed = features().with(|settings| {
        (settings.active_margin, settings.num_steps) = (3, 6);
        (settings.growth, settings.fade_matched, settings.fade_undecoded) = (GrowthRule::Missing, false, true);
    });
    let integers = features().with(|settings| settings.feature_dim = 1);
    for settings in [mixed, integers] {
        let [host, gpu] = compare(&settings, &device);
        assert_contents_agree(&host, &gpu);
    }
}

#[test]
fn a_full_map_of_features_loses_what_was_not_seen_for_longest() {
    let Some(device) = device() else { return };
    let [host, gpu] = compare(&features().with(|settings| settings.max_gaussians = 18_000), &device);
    assert_eq!((host.gaussian_count(), gpu.gaussian_count()), (16_875, 16_875));
    assert_contents_agree(&host, &gpu);
}

#[test]
fn new_gaussians_learn_alike() {
    let Some(device) = device() else { return };
    let settings = features().with(|settings| settings.learn_new = true);
    let (mut host, mut gpu) = (memory(settings.clone()), memory(settings).on_device(&device).unwrap());
    // Pixels that the map covers too little amplify every rounding, on the CPU as well: later frames drift apart.
    for (number, frame) in ROOM.iter().enumerate().take(4) {
        let (one, other) = (take_in(&mut host, frame, number), take_in(&mut gpu, frame, number));
        assert_maps_agree(&one.expected, &other.expected, "expected");
        assert_maps_agree(&one.fused[0], &other.fused[0], "fused");
        let learning = [&one, &other].map(|found| found.update.learning);
        assert!(learning[0].active_pixels > 0);
        assert_about(learning[0].active_pixels, learning[1].active_pixels, "active pixels");
        assert_about(learning[0].active_gaussians, learning[1].active_gaussians, "active");
    }
}

//! A segmenter, a namer and a kind of memory of another crate are chosen by their names, as the built-in ones are.

use splatseg::dataset::{FrameStream, GroundTruth, open_scene};
use splatseg::geometry::{RemappedId, RgbdFrame};
use splatseg::memory::{
    LearningStats, MemoryError, MemoryKindDefinition, MemoryRules, NewGaussian, Recall, SegmentStore, SplatMemory,
    StoreTile, TileSurface, register_memory_kind,
};
use splatseg::objects::ObjectName;
use splatseg::parts::{Namer, ObjectToName, PartContext, PartError, PartFile, PartFiles, PartSection, RegisterError};
use splatseg::pipeline::PipelineError;
use splatseg::render::{Splats, TileWeights};
use splatseg::segmenter::{GraphSettings, SegmenterError};
use splatseg::settings::{
    SegmenterSettings, SettingsError, SettingsLayers, TrackerSettings, describe_settings, entries, register_namer,
    register_segmenter, register_tracker,
};
use splatseg::tracking::{FastSamSplat, FastSamSplatSettings, FrameOutput, Method, TrackingError};
use splatseg::{
    CameraFrame, Mask, Pipeline, ScoredMask, SegmentId, SegmentMap, Segmentation, Segmenter, Settings, Tracker,
};
use splatseg_settings::{Allowed, settings};
use std::collections::BTreeSet;
use std::error::Error;
use std::sync::Once;

settings! {
    /// Settings of a segmenter that finds what is near.
    pub struct NearSettings in "near" {
        /// Largest distance, metres.
        distance: f32 = 2.5, Allowed::above_up_to(0.0, 100.0);
        /// One mask for each half of the image.
        halves: bool = true, Allowed::Switch;
    }
}

const WEIGHTS: PartFile = PartFile {
    key: "weights",
    help: "Not shown: other segmenters have the setting too.",
    what: "a file that is not read",
    called: "the file of --weights",
    is_required: false,
    is_checkpoint: true,
};

impl PartSection<dyn Segmenter> for NearSettings {
    const NAME: &'static str = "near";
    const HELP: &'static str = "What is near";
    const FILES: &'static [PartFile] = &[WEIGHTS];

    fn build(&self, _: &PartFiles, _: &PartContext<'_>) -> Result<Box<dyn Segmenter>, PartError> {
        Ok(Box::new(Near(self.clone())))
    }
}

struct Near(NearSettings);

impl Segmenter for Near {
    fn name(&self) -> &str {
        "near"
    }

    fn segment(&mut self, frame: &CameraFrame) -> Result<Segmentation, SegmenterError> {
        let (width, height) = (frame.width(), frame.height());
        let middle = if self.0.halves { width / 2 } else { width };
        let is_near = |column, row| {
            let depth = frame.depth()[(column, row)];
            depth > 0.0 && depth < self.0.distance
        };
        let halves = [0..middle, middle..width]
            .map(|half| Mask::from_fn(width, height, |column, row| half.contains(&column) && is_near(column, row)));
        let masks = halves.into_iter().filter(|mask| !mask.is_empty()).map(|mask| ScoredMask { mask, score: 1.0 });
        Ok(masks.collect::<Vec<_>>().into())
    }
}

settings! {
    /// Settings of a namer that calls every object the same.
    pub struct SameNameSettings in "same_name" {
        /// The label.
        label: String = "thing".to_owned(), Allowed::Text("a word");
    }
}

impl PartSection<dyn Namer> for SameNameSettings {
    const NAME: &'static str = "same-name";
    const HELP: &'static str = "Calls every object the same";

    fn build(&self, _: &PartFiles, _: &PartContext<'_>) -> Result<Box<dyn Namer>, PartError> {
        Ok(Box::new(SameName { label: self.label.clone(), calls: 0 }))
    }
}

struct SameName {
    label: String,
    calls: usize,
}

impl Namer for SameName {
    fn name(&self) -> &str {
        "same-name"
    }

    fn name_object(&mut self, _: ObjectToName<'_>) -> Result<ObjectName, Box<dyn Error + Send + Sync>> {
        self.calls += 1;
        match self.label.as_str() {
            "nothing" => Err("no words".into()),
            "nothing at first" if self.calls == 1 => Err("no words".into()),
            label => Ok(ObjectName { label: Some(label.to_owned()), embedding: Vec::new(), ..ObjectName::default() }),
        }
    }
}

/// Remembers nothing but how many Gaussians there are.
#[derive(Debug, Default)]
struct Forgetful(usize);

static FORGETFUL: MemoryKindDefinition = MemoryKindDefinition {
    name: "forgetful",
    rules: |_| MemoryRules::default(),
    create: |_, _| Ok(Box::new(Forgetful::default())),
    restore: |settings, saved| Err(saved.unexpected(settings)),
};

impl SegmentStore for Forgetful {
    fn read_tile(&self, _: &TileWeights, _: &TileSurface) -> StoreTile {
        let (segments, confidence) = (vec![0; TileWeights::PIXELS], vec![0.0; TileWeights::PIXELS]);
        StoreTile { segments, confidence, ..StoreTile::default() }
    }

    fn fuse(&self, _: &Recall<'_>, predicted: &SegmentMap) -> SegmentMap {
        predicted.clone()
    }

    fn grow(&mut self, added: &[NewGaussian], _: &Recall<'_>, _: &SegmentMap, _: &BTreeSet<SegmentId>) {
        self.0 += added.len();
    }

    fn learn(&mut self, _: &Recall<'_>, _: &dyn Splats, _: &SegmentMap, _: &BTreeSet<SegmentId>) -> LearningStats {
        LearningStats::default()
    }

    fn retain(&mut self, keep: &[bool]) {
        self.0 = keep.iter().filter(|keep| **keep).count();
    }

    fn new_segment(&mut self, _: SegmentId) -> Result<(), MemoryError> {
        Ok(())
    }

    fn segment_ids(&self) -> Vec<SegmentId> {
        vec![0; self.0]
    }

    fn numbers_per_gaussian(&self) -> usize {
        0
    }
}

/// Registers the parts, once in this program.
fn registered() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        register_segmenter::<NearSettings>().unwrap();
        register_memory_kind(&FORGETFUL).unwrap();
        register_namer::<SameNameSettings>().unwrap();
    });
}

fn resolve(assignments: &[&str]) -> Result<Settings, SettingsError> {
    registered();
    let mut layers = SettingsLayers::default();
    assignments.iter().try_for_each(|assignment| layers.add_assignment(assignment))?;
    layers.resolve()
}

#[test]
fn they_segment_and_remember() {
    let settings = resolve(&["segmenter=near", "near.distance=100", "memory.kind=forgetful"]).unwrap();
    let scene = open_scene("synthetic:frames=2,width=96,height=72", &settings.dataset).unwrap();
    let mut pipeline = Pipeline::builder(&settings).build().unwrap();
    for processed in pipeline.run(FrameStream::open(scene, &settings.dataset, GroundTruth::Skip).unwrap()) {
        let result = processed.unwrap().result.unwrap();
        assert!(!result.output.segments.areas().is_empty());
    }
    assert!(pipeline.memory().unwrap().gaussian_count() > 0);
}

/// A method that says in each frame that one more id is the object 1.
struct Recognising {
    method: FastSamSplat,
    frames: u32,
}

impl Method for Recognising {
    fn name(&self) -> &str {
        "recognising"
    }

    fn process(&mut self, frame: &RgbdFrame, found: &Segmentation) -> Result<FrameOutput, TrackingError> {
        let mut output = self.method.process(frame, found)?;
        output.update.remapped.push(RemappedId { from: 900 + self.frames, into: 1 });
        self.frames += 1;
        Ok(output)
    }

    fn memory(&self) -> Option<&SplatMemory> {
        self.method.memory()
    }
}

#[test]
fn ids_that_were_recognised_in_a_frame_whose_namer_failed_are_told_with_the_next() {
    let settings = resolve(&["namer=same-name", "same_name.label=nothing at first"]).unwrap();
    let method = FastSamSplat::new(FastSamSplatSettings::default(), 0, &mut |_| {}).unwrap();
    let method = Box::new(Recognising { method, frames: 0 });
    let mut pipeline = Pipeline::builder(&settings).method(method).build().unwrap();
    let scene = open_scene("synthetic:frames=3,width=96,height=72", &settings.dataset).unwrap();
    let (mut failures, mut told) = (0, Vec::new());
    for index in 0..3 {
        match pipeline.step(&scene.read_frame(index).unwrap()) {
            Ok(result) => told.extend(result.remapped.into_iter().map(|remapped| remapped.from)),
            Err(error) => {
                assert!(matches!(error, PipelineError::Namer { .. }), "{error}");
                failures += 1;
            }
        }
    }
    assert_eq!((failures, told), (1, vec![900, 901, 902]));
}

#[test]
fn a_registered_namer_names_objects_after_every_frame() {
    let run = |label: &str| {
        let label = format!("same_name.label={label}");
        let settings = resolve(&["namer=same-name", &label]).unwrap();
        let json = serde_json::to_string(&settings).unwrap();
        assert_eq!(serde_json::from_str::<Settings>(&json).unwrap(), settings);
        let scene = open_scene("synthetic:frames=3,width=96,height=72", &settings.dataset).unwrap();
        let mut pipeline = Pipeline::builder(&settings).build().unwrap();
        for processed in pipeline.run(FrameStream::open(scene, &settings.dataset, GroundTruth::Skip).unwrap()) {
            processed.unwrap().result?;
        }
        Ok::<_, PipelineError>(pipeline)
    };
    let pipeline = run("cup").unwrap();
    assert!(!pipeline.find_label("cup").is_empty());
    assert!(pipeline.object_list().objects.iter().any(|object| object.label.as_deref() == Some("cup")));
    let error = run("nothing").err().unwrap();
    assert!(matches!(error, PipelineError::Namer { .. }) && error.to_string().ends_with("no words"), "{error}");

    assert!(resolve(&[]).unwrap().namer.is_none());
    let error = resolve(&["same_name.label=cup"]).unwrap_err().to_string();
    assert_eq!(error, "same_name.label is not used here: it needs namer = same-name, but namer is not given");
    let error = resolve(&["namer=other"]).unwrap_err().to_string();
    assert_eq!(error, "namer is \"other\", expected clip or same-name");
}

#[test]
fn their_settings_are_checked_written_and_read() {
    let given = ["segmenter=near", "near.distance=0.3", "weights=near.pt", "memory.kind=forgetful"];
    let settings = resolve(&given).unwrap();
    let json = serde_json::to_string(&settings).unwrap();
    for part in ["\"segmenter\":\"near\"", "\"distance\":0.3", "\"weights\":\"near.pt\"", "\"kind\":\"forgetful\""] {
        assert!(json.contains(part), "{part}: {json}");
    }
    assert_eq!(serde_json::from_str::<Settings>(&json).unwrap(), settings);
    assert_eq!(toml::from_str::<Settings>(&toml::to_string(&settings).unwrap()).unwrap(), settings);
    let inputs: Vec<&str> = settings.input_files().iter().map(|input| input.what).collect();
    assert_eq!(inputs, ["the file of --weights"]);

    let mut in_code = Settings::default();
    let near = NearSettings::default().with(|near| near.distance = 0.3);
    in_code.segmenter = SegmenterSettings::of(near).with_file("weights", "near.pt");
    assert_eq!(in_code.segmenter, settings.segmenter);
    assert_ne!(in_code.segmenter, SegmenterSettings::of(NearSettings::default()));

    // The growth rule follows the kind of memory.
    assert!(resolve(&["memory.kind=forgetful", "memory.growth_spacing=4"]).is_ok());
    let cases: [(&[&str], &str); 5] = [
        (&["segmenter=near", "near.distance=0"], "near.distance is 0, expected more than 0 and at most 100"),
        (&["segmenter=near", "near.distanc=1"], "there is no setting near.distanc, did you mean near.distance?"),
        (&["near.distance=1"], "near.distance is not used here: it needs segmenter = near, but segmenter is affinity"),
        (&["segmenter=yolo"], "segmenter is \"yolo\", expected affinity, graph, fastsam, masks, oracle or near"),
        (&["memory.kind=xyz"], "memory.kind is \"xyz\", expected evidence, features or forgetful"),
    ];
    for (assignments, message) in cases {
        assert_eq!(resolve(assignments).unwrap_err().to_string(), message);
    }
    assert!(describe_settings("near").unwrap().contains("`near.halves`"));
    let weights = entries().into_iter().find(|entry| entry.field.key() == "weights").unwrap();
    assert_eq!(weights.needs[0].to_string(), "segmenter = affinity or fastsam or near");
    assert!(weights.field.help().starts_with("Checkpoint of FastSAM"));
}

#[test]
fn files_and_networks_that_parts_do_not_have_are_errors() {
    let mut settings = Settings::default();
    settings.segmenter = SegmenterSettings::of(GraphSettings::default()).with_file("weights", "a.pt");
    let error = settings.validate().unwrap_err().to_string();
    assert_eq!(error, "weights is a.pt, expected no value: segmenter = graph reads no such file");
    assert_eq!(TrackerSettings::default().name(), "sam2");
}

/// Declares settings whose part cannot be registered.
macro_rules! refused {
    ($name:ident in $section:literal, $part:literal, $field:ident) => {
        settings! {
            /// Settings of a part that cannot be registered.
            pub struct $name in $section {
                /// A setting.
                $field: usize = 1, Allowed::between(0.0, 9.0);
            }
        }

        impl PartSection<dyn Tracker> for $name {
            const NAME: &'static str = $part;
            const HELP: &'static str = "Cannot be registered";

            fn build(&self, _: &PartFiles, _: &PartContext<'_>) -> Result<Box<dyn Tracker>, PartError> {
                Err(PartError::Other { name: $part.to_owned(), source: "never built".into() })
            }
        }
    };
}

refused!(TakenName in "another", "sim", setting);
refused!(UnwritableName in "another", "My Tracker", setting);
refused!(TakenSection in "graph.more", "tracker-a", setting);
refused!(TakenKey in "", "tracker-b", seed);

#[test]
fn names_and_settings_that_exist_are_refused() {
    registered();
    let taken = RegisterError::Taken { kind: "segmenter", name: "near" };
    assert_eq!(register_segmenter::<NearSettings>(), Err(taken));
    let cases = [
        (register_tracker::<TakenName>(), "there is already a tracker named sim"),
        (
            register_tracker::<UnwritableName>(),
            "the name of a tracker is \"My Tracker\", expected lower-case letters, digits, - and _",
        ),
        (
            register_tracker::<TakenSection>(),
            "the tracker tracker-a has the setting graph.more.setting, but there is graph.min_area already",
        ),
        (register_tracker::<TakenKey>(), "the tracker tracker-b has the setting seed, but there is seed already"),
    ];
    for (result, message) in cases {
        assert_eq!(result.unwrap_err().to_string(), message);
    }
}

//! All settings of a run, with the same names in TOML files, `--set`, `summary.json` and the library.
//!
//! Each setting is declared once, with [`settings!`], in the crate that uses it. `registry.rs` lists all of them with
//! the method, segmenter, tracker or memory that each needs; TOML, `--set`, `--help`, `splatseg settings` and
//! `docs/SETTINGS.md` use that list. `layers.rs` combines files (`file.rs`), options, assignments and the settings
//! fixed by a saved memory. They override the defaults, of which `method_preset` changes some (`preset.rs`). `table.rs`
//! checks the values; settings that the choices do not use are errors (`usage.rs`), and every number has a range within
//! which a run does not hang. [`Settings::validate`] refuses a network that the program was built without, before
//! anything is read.

mod document;
mod error;
mod file;
mod input_files;
mod layers;
mod preset;
mod registration;
mod registry;
mod table;
mod toml_table;
mod usage;

pub use crate::parts::{
    ChosenValues, DepthPredictorSettings, Entry, MaskFolderSettings, MethodName, MethodSettings, MissingFile,
    NamerSettings, RegisterError, Requirement, SegmenterSettings, SettingsInput, TrackerSettings,
};
pub use document::{DescribedSetting, describe_settings, described_settings, markdown, settings_text};
pub use error::SettingsError;
pub use layers::SettingsLayers;
pub use preset::MethodPreset;
pub use registration::{register_depth_predictor, register_namer, register_segmenter, register_tracker};
pub use registry::{describe, entries};

use crate::pipeline::{PredictedDepthUse, Rotate};
use splatseg_dataset::{DatasetError, DatasetSettings, has_depth, lacks_depth_topic};
use splatseg_files::MemoryLimit;
use splatseg_models::device::{DeviceError, DeviceName, HAS_NETWORKS};
use splatseg_odometry::PoseMode;
use splatseg_segmenter::Detail;
use splatseg_settings::{Allowed, Choice, settings};
use std::path::Path;

/// Settings of a run: its method, its segmenter and the reading of its scene.
///
/// In TOML and JSON all parts are at one level: `method = "fastsam-splat"`, `memory.max_votes = 8`. Only settings of
/// the chosen method, segmenter, tracker and memory are written.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Settings {
    /// The method, with its settings.
    pub method: MethodSettings,
    /// The segmenter whose masks the method uses, with its settings.
    pub segmenter: SegmenterSettings,
    /// The namer, if objects are to be named.
    pub namer: Option<NamerSettings>,
    /// The depth predictor, if depth is to be predicted.
    pub depth_predictor: Option<DepthPredictorSettings>,
    /// Settings for reading the scene.
    pub dataset: DatasetSettings,
    /// Settings of every run.
    pub run: RunSettings,
}

settings! {
    /// Settings of every run, independent of its method.
    pub struct RunSettings in "" {
        /// Defaults of the other settings: ours or the paper's. Explicit values override both. `splatseg settings`
        /// lists both.
        method_preset: MethodPreset = MethodPreset::Splatseg, Allowed::Names(MethodPreset::NAMES);
        /// Source of the camera's poses. `auto`: those that come with the frames; frames without one are tracked. `given`:
        /// only those, frames without one are skipped. `track`: the camera is tracked, given poses are ignored except
        /// that of the first frame. `refine`: given poses drift, as a robot's odometry does, and are improved by
        /// tracking.
        poses: PoseMode = PoseMode::Auto, Allowed::Names(PoseMode::NAMES);
        /// Turns frames clockwise for the segmenter, which was trained on upright images: by 90, 180 or 270 degrees, 0 for
        /// not at all. `auto`: upright, once the camera has looked around and the floor is known. Results have the frames'
        /// own orientation.
        rotate: Rotate = Rotate::Auto, Allowed::Names(Rotate::NAMES);
        /// Frames of more pixels are processed at this resolution: the segmenter, the tracking of the camera and the memory
        /// see a reduced frame, and results are enlarged to its size along the edges of colour and depth. Segmenters that
        /// need all pixels see the whole frame.
        working_pixels: usize = 76_800, Allowed::between(1024.0, 67_108_864.0), only "method = fastsam-splat";
        /// Where predicted depth is used. `holes`: where the sensor has measured nothing, if the prediction agrees with it around
        /// there. `all`: in place of measured depth; it is fitted to the map.
        predicted_depth: PredictedDepthUse = PredictedDepthUse::Holes, Allowed::Names(PredictedDepthUse::NAMES);
        /// How finely frames are segmented: `coarse` for fewer and larger segments, `fine` for more and smaller ones. It shifts
        /// the log-odds at which two parts become one, `affinity.threshold` or `graph.borders.bias`, by 1.
        detail: Detail = Detail::Normal, Allowed::Names(Detail::NAMES);
        /// The device that runs the networks. Support for devices other than the CPU must be built in.
        device: DeviceName = DeviceName::Cpu, Allowed::Names(DeviceName::NAMES);
        /// Segments the next frame while the method processes this one. Results do not depend on it. Each stage takes
        /// longer, as both share the processor.
        segment_ahead: bool = true, Allowed::Switch;
        /// Makes `run` write `index.html`, a page that shows the map, the video and the list of objects.
        page: bool = true, Allowed::Switch;
        /// Makes `run` write `overlay/*.jpg`, the frames with their objects drawn over them. `--save-mcap` needs them.
        overlay: bool = true, Allowed::Switch;
        /// Leaves out the final pass, in which the map of the end decides the ids of all frames again. Results are then
        /// what was known at the time of each frame. The paper has no such pass.
        online: bool = false, Allowed::Switch;
        /// `bench` also scores results that are decided again when this many more frames have been seen, as `live --lag` shows
        /// them; 0: it does not.
        late_frames: usize = 0, Allowed::between(0.0, 1e4);
        /// Seed of all random numbers.
        seed: u64 = 0, Allowed::between(0.0, Allowed::MAX_WHOLE as f64);
        /// Ends the run at the first frame that cannot be used, instead of skipping it, and when the frames contradict
        /// what came with them, such as poses or units, instead of warning.
        strict_input: bool = false, Allowed::Switch;
        /// Number of frames between saves of the run's state, for `--resume`; 0: never saved. Only `fastsam-splat` can
        /// be resumed. Results do not depend on it.
        save_every: usize = 0, Allowed::between(0.0, 1e9);
        /// Number of threads; 0: one per core. Results do not depend on it.
        threads: usize = 0, Allowed::between(0.0, 512.0);
        /// The most memory that reading one input file may take, e.g. `4GB`; `auto`: the memory available on the machine. A
        /// file that claims to need more is refused. It does not limit the program in all: its map grows with what is seen,
        /// up to `memory.max_gaussians`. Results do not depend on it.
        memory_limit: MemoryLimit = MemoryLimit::Auto, Allowed::Text(MemoryLimit::EXPECTED);
    }
}

impl Settings {
    /// Checks that every setting is in range, every required file is given, and the networks and their device are built
    /// in.
    ///
    /// # Errors
    /// Names the first setting that is invalid or missing.
    pub fn validate(&self) -> Result<(), SettingsError> {
        self.method.validate()?;
        self.segmenter.validate()?;
        self.namer.as_ref().map_or(Ok(()), NamerSettings::validate)?;
        self.depth_predictor.as_ref().map_or(Ok(()), DepthPredictorSettings::validate)?;
        self.dataset.validate()?;
        self.run.validate()?;
        let segmenter = self.method.uses_segmenter().then_some(&self.segmenter);
        let tracker = self.method.tracker();
        let needs_networks = segmenter.is_some_and(SegmenterSettings::needs_networks)
            || tracker.is_some_and(TrackerSettings::needs_networks)
            || self.namer.as_ref().is_some_and(NamerSettings::needs_networks)
            || self.depth_predictor.as_ref().is_some_and(DepthPredictorSettings::needs_networks);
        if needs_networks && !HAS_NETWORKS {
            return Err(DeviceError::NoNetworks.into());
        }
        let missing = segmenter.and_then(SegmenterSettings::missing_input);
        let missing = missing.or_else(|| tracker?.missing_input()).or_else(|| self.namer.as_ref()?.missing_input());
        let missing = missing.or_else(|| self.depth_predictor.as_ref()?.missing_input());
        if let Some(missing) = missing {
            return Err(SettingsError::Missing(missing));
        }
        match self.device().filter(|device| !device.is_built()) {
            Some(device) => Err(DeviceError::NotBuilt(device.name()).into()),
            None => Ok(()),
        }
    }

    /// Settles what a source without depth needs: a depth predictor, whose depth is then used everywhere. `source` is the path
    /// of the scene. Of a recording whose topics have no depth, [`DatasetSettings::depth`] becomes `none`, if a predictor is
    /// chosen. Decodes no frame.
    ///
    /// # Errors
    /// [`SettingsError::NoDepth`] if the source has no depth and no predictor is chosen.
    pub fn settle_depth(&mut self, source: &Path) -> Result<(), SettingsError> {
        if self.depth_predictor.is_some() && lacks_depth_topic(source, &self.dataset) {
            self.dataset.depth = Some(DatasetSettings::NO_DEPTH.to_owned());
        }
        if has_depth(source, &self.dataset) {
            return Ok(());
        }
        self.predict_all_depth(source)
    }

    /// As [`Self::settle_depth`] for a stream, whose topics are not known yet: it has no depth if
    /// [`DatasetSettings::depth`] is `none`.
    ///
    /// # Errors
    /// As [`Self::settle_depth`]; `name` names the stream.
    pub fn settle_depth_of_stream(&mut self, name: &str) -> Result<(), SettingsError> {
        if self.dataset.depth.as_deref() == Some(DatasetSettings::NO_DEPTH) {
            self.predict_all_depth(Path::new(name))?;
        }
        Ok(())
    }

    fn predict_all_depth(&mut self, source: &Path) -> Result<(), SettingsError> {
        if self.depth_predictor.is_none() {
            return Err(SettingsError::NoDepth(DatasetError::NoDepth { path: source.to_owned() }));
        }
        self.run.predicted_depth = PredictedDepthUse::All;
        Ok(())
    }

    /// Returns the device of the networks, if there are any.
    pub fn device(&self) -> Option<DeviceName> {
        let segments = self.method.uses_segmenter() && self.segmenter.is_network();
        let tracks = self.method.tracker().is_some_and(TrackerSettings::is_network);
        let names = self.namer.as_ref().is_some_and(NamerSettings::is_network);
        let predicts = self.depth_predictor.as_ref().is_some_and(DepthPredictorSettings::is_network);
        (segments || tracks || names || predicts).then_some(self.run.device)
    }
}

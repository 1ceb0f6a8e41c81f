//! `splatseg export --as occupancy`: the plan of a saved map, for robots.

use super::Failure;
use super::export::{ExportArguments, Places, Wait};
use super::file_kind::FileKind;
use super::terminal::counted;
use clap::Args;
use image::ImageEncoder;
use image::codecs::png::PngEncoder;
use splatseg::pipeline::NamedMap;
use splatseg_geometry::SegmentId;
use splatseg_output::segment_color;
use splatseg_places::{Cell, FloorPlan, PlanFile, PlanPicture, PlanSettings, map_server};
use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Pixels of a cell's side in the picture.
const SCALE: usize = 4;
/// Radius of a robot if none is given, metres.
const RADIUS: f64 = 0.2;

/// Options of a plan.
#[derive(Debug, Args)]
pub struct PlanOptions {
    /// Side of a cell, metres [default: 0.05]
    #[arg(long, value_name = "M")]
    pub resolution: Option<f64>,
    /// Height above the floor from which things are obstacles, metres [default: 0.1]
    #[arg(long, value_name = "M")]
    pub min_height: Option<f64>,
    /// Height above the floor up to which things are obstacles, metres [default: 1.8]
    #[arg(long, value_name = "M")]
    pub max_height: Option<f64>,
    /// Radius of the robot, metres [default: 0.2]
    #[arg(long, value_name = "M")]
    pub robot_radius: Option<f64>,
    /// Take what is at most this far from the camera's path as free if nothing was seen there, metres [default: none]
    ///
    /// The camera hardly sees the floor below itself, but a robot or a person was there with it. That is an assumption: it
    /// may have been held over a table that it never saw.
    #[arg(long, value_name = "M")]
    pub free_path: Option<f64>,
}

impl PlanOptions {
    /// Refuses the options where they have no meaning.
    pub fn require_none(&self) -> Result<(), Failure> {
        let given = [
            ("--resolution", self.resolution),
            ("--min-height", self.min_height),
            ("--max-height", self.max_height),
            ("--robot-radius", self.robot_radius),
            ("--free-path", self.free_path),
        ];
        match given.iter().find(|(_, value)| value.is_some()) {
            Some((name, _)) => Err(Failure::input(format!("{name}: only --as occupancy has it"))),
            None => Ok(()),
        }
    }

    /// The settings of the plan, checked.
    pub fn settings(&self) -> Result<PlanSettings, Failure> {
        let default = PlanSettings::default();
        let settings = PlanSettings {
            resolution: self.resolution.unwrap_or(default.resolution),
            min_height: self.min_height.unwrap_or(default.min_height),
            max_height: self.max_height.unwrap_or(default.max_height),
            free_path: self.free_path.unwrap_or(default.free_path),
            ..default
        };
        settings.validated().map_err(Failure::input)
    }

    /// Radius of the robot, metres, checked.
    pub fn radius(&self) -> Result<f64, Failure> {
        let radius = self.robot_radius.unwrap_or(RADIUS);
        if (0.0..=5.0).contains(&radius) {
            return Ok(radius);
        }
        Err(Failure::input(format!("--robot-radius: found {radius}, expected 0 to 5")))
    }
}

/// Writes the image, the YAML file, the picture and the JSON file.
pub fn export_plan(arguments: &ExportArguments) -> Result<(), Failure> {
    let Some(out) = arguments.out.as_ref().filter(|_| arguments.object_files.is_none()) else {
        return Err(Failure::input("--as occupancy: give --out, and no --object-files: the plan has all objects"));
    };
    if arguments.min_confidence > 0.0 {
        return Err(Failure::input("--min-confidence: not with --as occupancy, where every surface is an obstacle"));
    }
    let (settings, radius) = (arguments.plan.settings()?, arguments.plan.radius()?);
    let files = PlanFiles::new(arguments, out)?;
    let map = NamedMap::load(&arguments.map).map_err(Failure::input)?;
    let wrong = |problem: &dyn std::fmt::Display| Failure::input(format!("{}: {problem}", arguments.map.display()));
    let plan = map.floor_plan(settings).map_err(|error| wrong(&error))?;
    let (ids, labels) = objects(&map);
    let shown: Vec<SegmentId> = if arguments.id.is_empty() { ids.clone() } else { arguments.id.clone() };
    if let Some(unknown) = shown.iter().find(|id| !ids.contains(id)) {
        return Err(wrong(&format!("found no object {unknown}")));
    }
    files.write(&plan, &labels, &shown, radius)?;
    let grid = plan.grid();
    report!(
        "{}: {} x {} cells of {} m, {:.1} m² free, {:.1} m² occupied, {}",
        files.image.display(),
        grid.shape.width,
        grid.shape.height,
        grid.shape.resolution,
        grid.area(Cell::Free),
        grid.area(Cell::Occupied),
        counted(plan.rooms().len(), "room"),
    );
    if !plan.frame().is_world() {
        report!("z is not up in the map: the grid is in a frame turned for it, see {}", files.yaml.display());
    }
    Ok(())
}

/// The ids of the objects that count, and the labels.
fn objects(map: &NamedMap) -> (Vec<SegmentId>, BTreeMap<SegmentId, String>) {
    let list = map.object_list();
    let ids = list.objects.iter().map(|object| object.id).collect();
    let labels = list.objects.iter().filter_map(|object| Some((object.id, object.label.clone()?))).collect();
    (ids, labels)
}

/// Where the files go.
struct PlanFiles {
    image: PathBuf,
    yaml: PathBuf,
    picture: PathBuf,
    json: PathBuf,
    places: Places,
}

impl PlanFiles {
    /// Checks that the files may be written.
    fn new(arguments: &ExportArguments, out: &Path) -> Result<Self, Failure> {
        let stem = match out.extension().and_then(|extension| extension.to_str()) {
            Some("pgm" | "yaml" | "png" | "json") => out.with_extension(""),
            _ => out.to_owned(),
        };
        if stem.file_name().is_none() {
            return Err(Failure::input(format!("{}: expected the name of a file", out.display())));
        }
        let with = |ending: &str| {
            let mut name = stem.clone().into_os_string();
            name.push(ending);
            PathBuf::from(name)
        };
        let places = Places::new(arguments);
        let files =
            Self { image: with(".pgm"), yaml: with(".yaml"), picture: with(".png"), json: with(".json"), places };
        files.check()?;
        Ok(files)
    }

    /// Checks all files, before any is written.
    fn check(&self) -> Result<(), Failure> {
        let Self { image, yaml, picture, json, places } = self;
        for (path, kind) in [
            (image, FileKind::PLAN_IMAGE),
            (yaml, FileKind::PLAN_YAML),
            (picture, FileKind::PLAN_PICTURE),
            (json, FileKind::PLAN),
        ] {
            places.check(path, kind)?;
        }
        // An image does not tell who wrote it: it is taken for one of a plan beside the text that was written with it.
        for (image, text) in [(image, yaml), (picture, json)] {
            if image.exists() && !text.exists() {
                let (image, text) = (image.display(), text.display());
                return Err(Failure::input(format!(
                    "{image}: exists without {text}, so it is not known to be of a plan: choose another --out"
                )));
            }
        }
        Ok(())
    }

    fn write(
        &self,
        plan: &FloorPlan,
        labels: &BTreeMap<SegmentId, String>,
        ids: &[SegmentId],
        radius: f64,
    ) -> Result<(), Failure> {
        let name = self.image.file_name().unwrap_or_default().to_string_lossy();
        let json = PlanFile::new(plan, labels, Some(ids), radius).to_json().map_err(Failure::runtime)?;
        self.write_one(&self.json, json.as_bytes())?;
        self.write_one(&self.picture, &png(plan, ids)?)?;
        self.write_one(&self.image, &map_server::pgm(plan.grid()))?;
        self.write_one(&self.yaml, map_server::yaml(plan.grid(), plan.frame(), &name).as_bytes())
    }

    fn write_one(&self, path: &Path, bytes: &[u8]) -> Result<(), Failure> {
        self.places.write_with(path, Wait::ForDisk, |file| file.write_all(bytes))
    }
}

/// The picture of a plan as a PNG file.
fn png(plan: &FloorPlan, ids: &[SegmentId]) -> Result<Vec<u8>, Failure> {
    let content = PlanPicture { scale: SCALE, objects: Some(ids), ..PlanPicture::default() };
    let picture = plan.picture(&content, segment_color);
    let (width, height) = (picture.width() as u32, picture.height() as u32);
    let mut bytes = Vec::new();
    PngEncoder::new(&mut bytes)
        .write_image(picture.pixels().as_flattened(), width, height, image::ExtendedColorType::Rgb8)
        .map_err(Failure::runtime)?;
    Ok(bytes)
}

//! How well the graph segmenter finds the objects of a scene.

use anyhow::Context;
use splatseg_dataset::{DatasetSettings, FrameStream, GroundTruth, ImageSize, open_scene};
use splatseg_geometry::{Mask, ScoredMask, SegmentMap};
use splatseg_output::write_overlay_jpeg;
use splatseg_segmenter::{GraphSegmenter, GraphSettings, Segmenter};
use std::path::PathBuf;
use std::time::Instant;

/// Objects smaller than this in a frame are not scored, pixels.
const MIN_OBJECT: usize = 400;

/// Score the graph segmenter's masks, frame by frame, against a scene's labels
///
/// Without labels only overlays and times are made.
#[derive(clap::Args)]
pub struct Arguments {
    /// The scene, of any format that `splatseg run` reads
    scene: String,
    /// Folder for overlays
    #[arg(long)]
    out: Option<PathBuf>,
    /// Use every N-th frame
    #[arg(long, value_name = "N", default_value_t = 1)]
    stride: usize,
    /// Resize frames first, e.g. 320x240
    #[arg(long, value_name = "WxH")]
    resize: Option<ImageSize>,
    /// Then cut this many pixels off on each side
    #[arg(long, value_name = "PX", default_value_t = 0)]
    crop_border: usize,
    /// JSON file with settings of the segmenter
    #[arg(long, value_name = "FILE")]
    settings: Option<PathBuf>,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let settings = match &arguments.settings {
        Some(path) => {
            let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
            serde_json::from_str(&text).with_context(|| path.display().to_string())?
        }
        None => GraphSettings::default(),
    };
    let dataset = DatasetSettings::default().with(|settings| {
        settings.stride = arguments.stride;
        settings.resize = arguments.resize;
        settings.crop_border = arguments.crop_border;
    });
    let mut segmenter = GraphSegmenter::new(settings)?;
    let mut totals = Totals::default();
    if let Some(out) = &arguments.out {
        std::fs::create_dir_all(out).with_context(|| out.display().to_string())?;
    }
    let scene = open_scene(&arguments.scene, &dataset)?;
    for streamed in FrameStream::open(scene, &dataset, GroundTruth::Read)? {
        let streamed = streamed?;
        let start = Instant::now();
        let masks = segmenter.segment(&streamed.frame)?;
        totals.milliseconds += start.elapsed().as_secs_f64() * 1e3;
        totals.frames += 1;
        totals.segments += masks.len();
        if let Some(truth) = &streamed.ground_truth {
            totals.score(truth, &masks);
        }
        if let Some(out) = &arguments.out {
            let path = out.join(format!("{}.jpg", streamed.frame.name()));
            let (width, height) = (streamed.frame.width(), streamed.frame.height());
            write_overlay_jpeg(&path, streamed.frame.color(), &segment_map(width, height, &masks)?)?;
        }
    }
    totals.print();
    Ok(())
}

/// The masks with ids from 1 in their order; later ones lie over earlier ones.
fn segment_map(width: usize, height: usize, masks: &[ScoredMask]) -> anyhow::Result<SegmentMap> {
    let mut ids = vec![0; width * height];
    for (id, segment) in (1..).zip(masks) {
        segment.mask.pixel_indices().for_each(|pixel| ids[pixel] = id);
    }
    Ok(SegmentMap::from_pixels(width, height, ids)?)
}

#[derive(Default)]
struct Totals {
    frames: usize,
    segments: usize,
    milliseconds: f64,
    objects: usize,
    best_iou: f64,
    best_f: f64,
    found: usize,
    pieces: usize,
    labelled: usize,
    foreign: usize,
}

impl Totals {
    fn score(&mut self, truth: &SegmentMap, masks: &[ScoredMask]) {
        let objects = Mask::of_segments(truth);
        let overlaps: Vec<Vec<usize>> = masks
            .iter()
            .map(|segment| objects.iter().map(|(_, object)| segment.mask.intersection_area(object)).collect())
            .collect();
        let owners: Vec<usize> =
            overlaps.iter().map(|row| (0..row.len()).max_by_key(|index| row[*index]).unwrap_or(usize::MAX)).collect();
        for (row, owner) in overlaps.iter().zip(&owners) {
            let labelled: usize = row.iter().sum();
            self.labelled += labelled;
            self.foreign += labelled - row.get(*owner).copied().unwrap_or(0);
        }
        for (index, (_, object)) in objects.iter().enumerate().filter(|(_, (_, object))| object.area() >= MIN_OBJECT) {
            let best = masks.iter().map(|segment| segment.mask.iou(object)).fold(0.0, f64::max);
            self.objects += 1;
            self.best_iou += best;
            self.best_f += 2.0 * best / (1.0 + best);
            self.found += usize::from(best > 0.5);
            self.pieces += owners.iter().filter(|owner| **owner == index).count();
        }
    }

    fn print(&self) {
        let frames = self.frames.max(1) as f64;
        println!("frames                               {}", self.frames);
        println!("ms per frame                         {:.1}", self.milliseconds / frames);
        println!("segments per frame                   {:.1}", self.segments as f64 / frames);
        if self.objects > 0 {
            let objects = self.objects as f64;
            println!("objects over {MIN_OBJECT} px, per frame        {:.1}", objects / frames);
            println!("mean best IoU                        {:.3}", self.best_iou / objects);
            println!("mean best F                          {:.3}", self.best_f / objects);
            println!("objects with IoU > 0.5               {:.3}", self.found as f64 / objects);
            println!("over-segmentation, pieces per object {:.2}", self.pieces as f64 / objects);
            println!("under-segmentation, foreign pixels   {:.3}", self.foreign as f64 / self.labelled.max(1) as f64);
        }
    }
}

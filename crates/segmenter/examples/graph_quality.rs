//! How well the graph segmenter finds the objects of a scene in ScanNet's exported layout.
//!
//! `cargo run --release -p splatseg-segmenter --example graph_quality -- SCENE [--out DIR] [--every N] [--crop PX]
//! [--settings FILE.json]`
//!
//! Scores need `instance-filt/`; without it only overlays and timing are made. A folder of `frame-*.color.jpg` (the
//! 7-Scenes layout, halved to 320×240) is read too, for looking at overlays.

use glam::Mat4;
use image::{GrayImage, RgbImage, imageops};
use splatseg_geometry::{Image, Intrinsics, Mask, Pose, RgbdFrame, ScoredMask, SegmentMap};
use splatseg_segmenter::{GraphSegmenter, GraphSettings, Segmenter};
use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;

type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// Objects smaller than this in a frame are not scored, pixels.
const MIN_OBJECT: usize = 400;

struct Options {
    scene: PathBuf,
    out: Option<PathBuf>,
    every: usize,
    crop: usize,
    settings: GraphSettings,
}

struct View {
    frame: RgbdFrame<'static>,
    truth: Option<SegmentMap>,
}

fn main() -> Result<()> {
    let options = options()?;
    let mut segmenter = GraphSegmenter::new(options.settings.clone())?;
    let mut totals = Totals::default();
    for name in names(&options.scene)?.into_iter().step_by(options.every) {
        let view = read_view(&options, &name)?;
        let start = Instant::now();
        let masks = segmenter.segment(&view.frame)?;
        totals.milliseconds += start.elapsed().as_secs_f64() * 1e3;
        totals.frames += 1;
        totals.segments += masks.len();
        if let Some(truth) = &view.truth {
            totals.score(truth, &masks);
        }
        if let Some(out) = &options.out {
            std::fs::create_dir_all(out)?;
            overlay(&view.frame, &masks).save(out.join(format!("{name}.png")))?;
        }
    }
    totals.print();
    Ok(())
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

fn options() -> Result<Options> {
    let mut words = std::env::args().skip(1);
    let scene =
        words.next().ok_or("usage: graph_quality SCENE [--out DIR] [--every N] [--crop PX] [--settings FILE]")?;
    let mut options = Options { scene: scene.into(), out: None, every: 1, crop: 0, settings: GraphSettings::default() };
    while let Some(word) = words.next() {
        let value = words.next().ok_or(format!("{word} needs a value"))?;
        match word.as_str() {
            "--out" => options.out = Some(value.into()),
            "--every" => options.every = value.parse::<usize>()?.max(1),
            "--crop" => options.crop = value.parse()?,
            "--settings" => options.settings = serde_json::from_str(&std::fs::read_to_string(value)?)?,
            _ => return Err(format!("unknown option {word}").into()),
        }
    }
    Ok(options)
}

/// Frame names in the order of the video.
fn names(scene: &Path) -> Result<Vec<String>> {
    let scannet = scene.join("color");
    let (folder, ending) = if scannet.is_dir() { (&*scannet, ".jpg") } else { (scene, ".color.jpg") };
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        if let Some(name) = entry?.file_name().to_str().and_then(|name| name.strip_suffix(ending)) {
            names.push(name.to_owned());
        }
    }
    names.sort_by_key(|name| (name.len(), name.clone()));
    Ok(names)
}

fn read_view(options: &Options, name: &str) -> Result<View> {
    let scene = &options.scene;
    if !scene.join("color").is_dir() {
        return read_seven_scenes(options, name);
    }
    let color = read_color(&scene.join(format!("color/{name}.jpg")))?;
    let depth = image::open(scene.join(format!("depth/{name}.png")))?.into_luma16();
    let numbers = numbers(&scene.join("intrinsic/intrinsic_color.txt"))?;
    let camera = camera([numbers[0], numbers[5], numbers[2], numbers[6]], &color);
    let truth = match image::open(scene.join(format!("instance-filt/{name}.png"))) {
        Ok(truth) => {
            let truth = truth.into_luma16();
            let pixels = truth.pixels().map(|pixel| u32::from(pixel.0[0])).collect();
            let (width, height) = (truth.width() as usize, truth.height() as usize);
            Some(SegmentMap::from_pixels(width, height, pixels)?.crop_border(options.crop))
        }
        Err(_) => None,
    };
    Ok(View { frame: frame(name, &color, &depth, camera, options.crop)?, truth })
}

fn read_seven_scenes(options: &Options, name: &str) -> Result<View> {
    let color = read_color(&options.scene.join(format!("{name}.color.jpg")))?;
    let depth = image::open(options.scene.join(format!("{name}.depth.png")))?.into_luma16();
    let numbers = numbers(&options.scene.join("camera-intrinsics.txt"))?;
    let full = camera([numbers[0], numbers[4], numbers[2], numbers[5]], &color);
    let color = imageops::resize(&color, 320, 240, imageops::FilterType::Triangle);
    let depth = imageops::resize(&depth, 320, 240, imageops::FilterType::Nearest);
    Ok(View { frame: frame(name, &color, &depth, full.resized(320, 240), options.crop)?, truth: None })
}

/// A colour image as the command reads it.
fn read_color(path: &Path) -> Result<RgbImage> {
    let color = splatseg_dataset::read_color_image(path)?;
    let pixel = |column: u32, row: u32| image::Rgb(color[(column as usize, row as usize)]);
    Ok(RgbImage::from_fn(color.width() as u32, color.height() as u32, pixel))
}

fn numbers(path: &Path) -> Result<Vec<f32>> {
    let text = std::fs::read_to_string(path)?;
    let numbers: Vec<f32> = text.split_whitespace().map(str::parse).collect::<std::result::Result<_, _>>()?;
    if numbers.len() < 9 {
        return Err(format!("{}: found {} numbers, expected a matrix", path.display(), numbers.len()).into());
    }
    Ok(numbers)
}

fn camera([fx, fy, cx, cy]: [f32; 4], color: &RgbImage) -> Intrinsics {
    Intrinsics { fx, fy, cx, cy, width: color.width() as usize, height: color.height() as usize }
}

fn frame(
    name: &str,
    color: &RgbImage,
    depth: &image::ImageBuffer<image::Luma<u16>, Vec<u16>>,
    camera: Intrinsics,
    crop: usize,
) -> Result<RgbdFrame<'static>> {
    let (width, height) = (camera.width, camera.height);
    let color = Image::from_pixels(width, height, color.pixels().map(|pixel| pixel.0).collect())?;
    let depth = Image::from_pixels(width, height, depth.pixels().map(|p| f32::from(p.0[0]) / 1000.0).collect())?;
    let pose = Pose::from_matrix(Mat4::IDENTITY)?;
    Ok(RgbdFrame::new(name, color.crop_border(crop), depth.crop_border(crop), camera.cropped(crop), pose)?)
}

/// The frame beside its segments, in colours that tell neighbours apart; outlines are black.
fn overlay(frame: &RgbdFrame, masks: &[ScoredMask]) -> RgbImage {
    let (width, height) = (frame.width(), frame.height());
    let mut labels = GrayImage::new(width as u32, height as u32);
    for (index, segment) in masks.iter().enumerate() {
        for pixel in segment.mask.pixel_indices() {
            labels.put_pixel((pixel % width) as u32, (pixel / width) as u32, image::Luma([(index % 255) as u8 + 1]));
        }
    }
    RgbImage::from_fn(2 * width as u32, height as u32, |column, row| {
        let (x, y) = (column as usize % width, row as usize);
        let color = frame.color()[(x, y)];
        if (column as usize) < width {
            return image::Rgb(color);
        }
        let label = labels.get_pixel(x as u32, row).0[0];
        let right = labels.get_pixel((x as u32 + 1).min(width as u32 - 1), row).0[0];
        let below = labels.get_pixel(x as u32, (row + 1).min(height as u32 - 1)).0[0];
        if label == 0 || label != right || label != below {
            return image::Rgb([0; 3]);
        }
        let hue = [label.wrapping_mul(97), label.wrapping_mul(57).wrapping_add(80), label.wrapping_mul(173)];
        image::Rgb([0, 1, 2].map(|channel| (u16::from(color[channel]) * 2 / 5 + u16::from(hue[channel]) * 3 / 5) as u8))
    })
}

//! Frames side by side: image, ground truth and every method.

use crate::Benchmark;
use maud::{Markup, html};
use serde::Serialize;

/// Most pictures on a page, so that it stays a few megabytes.
const MAX_PICTURES: usize = 640;
/// Fewest frames of a scene, however many pictures that makes.
const MIN_FRAMES: usize = 6;
/// Most methods side by side; if there are more, variants with changed settings are left out.
const MAX_METHODS: usize = 8;

/// A frame of a scene, without any method's results.
#[derive(Clone, Debug)]
pub struct ScenePicture {
    /// Name of the frame.
    pub frame: String,
    /// Its image as `data:` URI.
    pub image: String,
    /// Its ground truth, drawn over the image, as `data:` URI; `None` where there is none.
    pub ground_truth: Option<String>,
}

/// The frames of one scene that the page shows.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Strip {
    /// Name of the scene.
    scene: String,
    /// Names of the frames.
    frames: Vec<String>,
    /// What is side by side.
    panels: Vec<Panel>,
}

/// One row of pictures.
#[derive(Clone, Debug, Serialize)]
struct Panel {
    label: String,
    /// One `data:` URI per frame; null where there is none.
    images: Vec<Option<String>>,
}

/// How many frames of each scene the page of a benchmark shows.
pub fn frames_per_strip(benchmark: &Benchmark) -> usize {
    let panels = shown_variants(benchmark).len() + 2;
    (MAX_PICTURES / (panels * benchmark.scenes.len().max(1))).max(MIN_FRAMES)
}

fn shown_variants(benchmark: &Benchmark) -> Vec<usize> {
    let mut variants: Vec<usize> = (0..benchmark.variants.len()).collect();
    if variants.len() > MAX_METHODS {
        variants.retain(|variant| benchmark.variants[*variant].changes.is_empty());
        variants.truncate(MAX_METHODS);
    }
    variants
}

impl Strip {
    /// The scene's pictures, then every method's thumbnails of the same frames, with the first seed.
    pub(super) fn new(benchmark: &Benchmark, scene: usize, pictures: &[ScenePicture]) -> Self {
        let images = pictures.iter().map(|picture| Some(picture.image.clone())).collect();
        let truths = pictures.iter().map(|picture| picture.ground_truth.clone()).collect();
        let mut panels = vec![
            Panel { label: "image".to_owned(), images },
            Panel { label: "ground truth".to_owned(), images: truths },
        ];
        for variant in shown_variants(benchmark) {
            let Some(measurement) = benchmark.of(scene, variant).next() else { continue };
            let image = |picture: &ScenePicture| {
                let thumbnail = measurement.thumbnails.iter().find(|thumbnail| thumbnail.frame == picture.frame);
                thumbnail.map(|thumbnail| thumbnail.image.clone())
            };
            let label = benchmark.variants[variant].label();
            panels.push(Panel { label, images: pictures.iter().map(image).collect() });
        }
        let frames = pictures.iter().map(|picture| picture.frame.clone()).collect();
        Self { scene: benchmark.scenes[scene].clone(), frames, panels }
    }

    /// The strip for the page, at its first frame. `index` is its place in the page's data.
    pub(super) fn markup(&self, index: usize) -> Markup {
        let Some(first) = self.frames.first() else {
            return Markup::default();
        };
        html! {
            div class="strip" data-strip=(index) {
                div class="panels" {
                    @for panel in &self.panels {
                        @let source = panel.images.first().and_then(Option::as_deref).unwrap_or("data:,");
                        figure {
                            img alt=(panel.label) src=(source);
                            figcaption { (panel.label) }
                        }
                    }
                }
                label {
                    "frame " output { (first) }
                    input type="range" min="0" max=(self.frames.len() - 1) value="0"
                        aria-label={ "frame of " (self.scene) };
                }
                p class="facts" {
                    "A colour stands for an id: an object whose colour changes from frame to frame has lost its id. \
                    Colours are not comparable between pictures side by side. Results are those of the first seed."
                }
            }
        }
    }
}

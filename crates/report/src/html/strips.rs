//! Frames side by side: image, ground truth and methods.

use super::PageSelection;
use crate::{Benchmark, SceneDrawings};
use maud::{Markup, html};
use serde::Serialize;

/// The frames of one scene on the page.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Strip {
    /// Name of the scene.
    scene: String,
    /// Names of the frames.
    frames: Vec<String>,
    /// The rows of pictures.
    panels: Vec<Panel>,
}

/// One row of pictures.
#[derive(Clone, Debug, Serialize)]
struct Panel {
    label: String,
    /// Index of the variant; null for the image and the ground truth, which are always visible.
    variant: Option<usize>,
    /// True if it is initially visible.
    open: bool,
    /// One `data:` URI per frame; null for a frame without a picture.
    images: Vec<Option<String>>,
}

impl Strip {
    /// The scene's pictures, then each selected variant's thumbnails of the same frames.
    pub(super) fn new(benchmark: &Benchmark, selection: &PageSelection, drawings: &SceneDrawings) -> Self {
        let pictures = &drawings.pictures;
        let of_scene = |label: &str, images| Panel { label: label.to_owned(), variant: None, open: true, images };
        let images = pictures.iter().map(|picture| Some(picture.image.clone())).collect();
        let truths = pictures.iter().map(|picture| picture.ground_truth.clone()).collect();
        let mut panels = vec![of_scene("image", images), of_scene("ground truth", truths)];
        for run in drawings.runs.iter().filter(|run| selection.variants.contains(&run.variant)) {
            let images = pictures.iter().map(|picture| {
                let thumbnail = run.thumbnails.iter().find(|thumbnail| thumbnail.frame == picture.frame);
                thumbnail.map(|thumbnail| thumbnail.image.clone())
            });
            panels.push(Panel {
                label: benchmark.variants[run.variant].label(),
                variant: Some(run.variant),
                open: selection.open.contains(&run.variant),
                images: images.collect(),
            });
        }
        let frames = pictures.iter().map(|picture| picture.frame.clone()).collect();
        Self { scene: benchmark.scenes[drawings.scene].clone(), frames, panels }
    }

    /// The strip for the page, at its first frame. `index` is its index in the page's data.
    pub(super) fn markup(&self, index: usize) -> Markup {
        let Some(first) = self.frames.first() else {
            return Markup::default();
        };
        html! {
            div class="strip" data-strip=(index) {
                div class="panels" {
                    @for panel in &self.panels {
                        // The script sets a hidden panel's picture when the panel is shown.
                        @let source = panel.images.first().and_then(Option::as_deref).filter(|_| panel.open);
                        figure data-variant=[panel.variant] hidden[!panel.open] {
                            img alt=(panel.label) src=(source.unwrap_or("data:,"));
                            figcaption { (panel.label) }
                        }
                    }
                }
                label {
                    "frame " output { (first) }
                    input type="range" min="0" max=(self.frames.len() - 1) value="0"
                        aria-label={ "frame of " (self.scene) };
                }
            }
        }
    }
}

/// Check boxes that select the visible methods of all strips; empty if all methods are visible.
pub(super) fn chooser(benchmark: &Benchmark, selection: &PageSelection) -> Markup {
    if selection.variants == selection.open {
        return Markup::default();
    }
    html! {
        fieldset class="chooser" {
            legend { "Methods side by side" }
            @for variant in &selection.variants {
                label {
                    input type="checkbox" value=(variant) checked[selection.open.contains(variant)];
                    (benchmark.variants[*variant].label())
                }
            }
        }
    }
}

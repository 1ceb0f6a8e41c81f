//! Frames side by side: image, truth and every method.

use super::html::escape;
use crate::command::bench::Results;
use crate::command::bench::plan::SceneEntry;
use crate::command::bench::thumbnail::{StripFrames, jpeg_data_uri};
use serde::Serialize;
use splatseg_dataset::{DatasetSettings, open_scene};

/// Most pictures on a page, so that it stays a few megabytes.
const MOST_PICTURES: usize = 640;
/// Fewest frames of a scene, whatever the number of pictures.
const FEWEST_FRAMES: usize = 6;
/// Most methods side by side; with more, ablated ones are left out.
const MOST_METHODS: usize = 8;

/// The frames of one scene.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Strip {
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

/// The strip of every scene; empty for scenes that cannot be read any more.
pub fn of_scenes(results: &Results) -> Vec<Strip> {
    let plan = results.plan;
    let mut variants: Vec<usize> = (0..plan.variants.len()).collect();
    if variants.len() > MOST_METHODS {
        variants.retain(|variant| plan.variants[*variant].changes.is_empty());
        variants.truncate(MOST_METHODS);
    }
    let panels = variants.len() + 2;
    let frames = (MOST_PICTURES / (panels * plan.scenes.len().max(1))).max(FEWEST_FRAMES);
    let strip = |(scene, entry)| {
        // A scene that has gone since it was measured is no reason to have no report.
        let mut strip = of_scene(entry, &plan.settings.dataset, frames).unwrap_or_else(|error| {
            tracing::warn!("{}: no pictures: {error}", entry.path);
            Strip::default()
        });
        for variant in &variants {
            if let Some(finished) = results.of(scene, *variant).next() {
                let drawn = &finished.result.strip;
                let image = |name: &String| {
                    drawn.iter().find(|thumbnail| thumbnail.frame == *name).map(|thumbnail| thumbnail.image.clone())
                };
                let images = strip.frames.iter().map(image).collect();
                strip.panels.push(Panel { label: plan.variants[*variant].label(), images });
            }
        }
        strip
    };
    plan.scenes.iter().enumerate().map(strip).collect()
}

/// Image and truth of at most `most` of the frames that methods were drawn at.
fn of_scene(entry: &SceneEntry, settings: &DatasetSettings, most: usize) -> Result<Strip, String> {
    let text = |error: &dyn std::fmt::Display| error.to_string();
    let scene = open_scene(&entry.path, settings).map_err(|error| text(&error))?;
    let selected = settings.selected_frames(scene.frame_count()).map_err(|error| text(&error))?;
    let drawn = StripFrames::of(selected.len());
    let drawn: Vec<usize> = selected
        .iter()
        .enumerate()
        .filter(|(position, _)| drawn.contains(*position))
        .map(|(_, index)| *index)
        .collect();
    let step = drawn.len().div_ceil(most.max(1)).max(1);
    let (mut names, mut images, mut truths) = (Vec::new(), Vec::new(), Vec::new());
    for index in drawn.into_iter().step_by(step) {
        // Frames that cannot be read were skipped by the methods, too.
        let Ok(frame) = scene.read_frame(index).and_then(|frame| settings.framing().apply(frame)) else {
            continue;
        };
        let truth = scene.read_ground_truth(index).ok().flatten();
        let truth = truth.and_then(|truth| settings.framing().apply_to_labels(truth).ok());
        names.push(frame.name().to_owned());
        images.push(Some(jpeg_data_uri(frame.color(), None)?));
        truths.push(truth.map(|truth| jpeg_data_uri(frame.color(), Some(&truth))).transpose()?);
    }
    let panels =
        vec![Panel { label: "image".to_owned(), images }, Panel { label: "ground truth".to_owned(), images: truths }];
    Ok(Strip { scene: entry.name.clone(), frames: names, panels })
}

impl Strip {
    /// The strip for the page, at its first frame. `index` is its place in the page's data.
    pub fn html(&self, index: usize) -> String {
        let Some(first) = self.frames.first() else {
            return String::new();
        };
        let panels = self.panels.iter().map(|panel| {
            let source = panel.images.first().and_then(Option::as_deref).unwrap_or("data:,");
            let label = escape(&panel.label);
            format!("<figure><img alt=\"{label}\" src=\"{source}\"><figcaption>{label}</figcaption></figure>")
        });
        format!(
            "<div class=\"strip\" data-strip=\"{index}\"><div class=\"panels\">{}</div>\
             <label>frame <output>{}</output><input type=\"range\" min=\"0\" max=\"{}\" value=\"0\" \
             aria-label=\"frame of {}\"></label>\
             <p class=\"facts\">One colour, one id: a thing that changes its colour from frame to frame has lost its id. \
             The colours of different pictures have nothing to do with each other. First seed.</p></div>",
            panels.collect::<String>(),
            escape(first),
            self.frames.len() - 1,
            escape(&self.scene)
        )
    }
}

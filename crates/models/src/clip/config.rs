//! The sizes of a CLIP network: from the shapes of its tensors, and what those do not tell from a `config.json`.

use super::layout::{self, ClipLayout};
use super::{ClipError, ClipTokenizer};
use crate::checkpoint::{Checkpoint, printable};
use crate::transformer::{BlockNames, TowerConfig};
use serde_json::Value;
use splatseg_kernels::Activation;
use std::path::PathBuf;

/// Channels per attention head of most published networks of these layouts.
const HEAD_WIDTH: usize = 64;
/// Widths of the image towers that have 16 heads all the same: ViT-H/14, ViT-g/14, ViT-bigG/14 and ViT-e/14.
const WIDE_TOWERS: [usize; 4] = [1280, 1408, 1664, 1792];
/// Limits far above every published network, so that no file makes the program take all memory.
const MAX_WIDTH: usize = 4096;
const MAX_BLOCKS: usize = 96;
const MAX_TOKENS: usize = 4097;
const MAX_CONTEXT: usize = 1024;
/// Configurations beside a checkpoint, in order of preference.
const CONFIG_FILES: [&str; 2] = ["open_clip_config.json", "config.json"];

/// Mean and standard deviation of the images that most CLIP networks were trained with.
const OPENAI_NORMALISATION: [[f32; 3]; 2] =
    [[0.481_454_66, 0.457_827_5, 0.408_210_73], [0.268_629_54, 0.261_302_6, 0.275_777_1]];
const HALVES: [[f32; 3]; 2] = [[0.5; 3], [0.5; 3]];

/// Sizes of a CLIP network, and how its input is prepared.
#[derive(Clone, Debug, PartialEq)]
pub struct ClipConfig {
    /// Names of the tensors.
    pub layout: ClipLayout,
    /// Side of the input image, pixels.
    pub image_size: usize,
    /// Side of a patch, pixels.
    pub patch: usize,
    /// The image tower.
    pub image: TowerConfig,
    /// Heads of the attention pooling of a Perception Encoder.
    pub pooling_heads: usize,
    /// The text tower.
    pub text: TowerConfig,
    /// Maximum number of tokens, with those for start and end.
    pub context: usize,
    /// Length of the embeddings.
    pub embedding: usize,
    /// Mean and standard deviation by which images are normalised, of channels from 0 to 1.
    pub normalisation: [[f32; 3]; 2],
    /// Assumptions where neither shapes nor a configuration decide, in words; empty if there are none.
    pub assumed: Vec<String>,
}

/// A JSON configuration with its origin.
struct Given {
    path: PathBuf,
    json: Value,
}

impl ClipConfig {
    /// Reads the sizes of a checkpoint, and the configuration in its metadata or beside it, if there is one.
    ///
    /// # Errors
    /// If the checkpoint is not of a CLIP network, or a size is impossible or not supported.
    pub fn of(checkpoint: &Checkpoint) -> Result<Self, ClipError> {
        let path = checkpoint.path();
        let Some(layout) = ClipLayout::of(checkpoint) else {
            let found = format!("{} ({})", checkpoint.architecture(), checkpoint.first_names());
            return Err(ClipError::OtherNetwork { path: path.to_owned(), found });
        };
        Reader { checkpoint, layout, given: Given::find(checkpoint)?, assumed: Vec::new() }.config()
    }

    /// Number of patches along a side.
    pub fn grid(&self) -> usize {
        self.image_size / self.patch
    }
}

impl Given {
    /// The configuration of a checkpoint: in its metadata, else in a file beside it.
    fn find(checkpoint: &Checkpoint) -> Result<Option<Self>, ClipError> {
        let path = checkpoint.path();
        if let Some(json) = checkpoint.configuration().filter(|json| json.is_object()) {
            return Ok(Some(Self { path: path.to_owned(), json: json.clone() }));
        }
        let Some((path, json)) = checkpoint.configuration_beside(&CONFIG_FILES)? else { return Ok(None) };
        let is_clip = ["vision_cfg", "vision_config", "model_cfg"].iter().any(|key| json.get(key).is_some());
        Ok(is_clip.then_some(Self { path, json }))
    }

    /// A value of the section of a tower: `vision_cfg` or `vision_config`, in `model_cfg` or on top.
    fn value(&self, tower: &str, key: &str) -> Option<&Value> {
        let root = self.json.get("model_cfg").unwrap_or(&self.json);
        ["cfg", "config"].iter().find_map(|ending| root.get(format!("{tower}_{ending}"))?.get(key))
    }
}

struct Reader<'a> {
    checkpoint: &'a Checkpoint,
    layout: ClipLayout,
    given: Option<Given>,
    assumed: Vec<String>,
}

impl Reader<'_> {
    fn config(mut self) -> Result<ClipConfig, ClipError> {
        let (patches, positions, projection) = match self.layout {
            ClipLayout::OpenClip => ("visual.conv1.weight", "visual.positional_embedding", "visual.proj"),
            ClipLayout::HuggingFace => (
                "vision_model.embeddings.patch_embedding.weight",
                "vision_model.embeddings.position_embedding.weight",
                "visual_projection.weight",
            ),
            ClipLayout::PerceptionEncoder => {
                ("visual.trunk.patch_embed.proj.weight", "visual.trunk.pos_embed", "visual.trunk.head.weight")
            }
        };
        let [width, channels, patch, patch_width] = self.shape(patches)?;
        self.check(
            "patches",
            format!("{channels} channels, {patch_width} x {patch}"),
            "square patches of 3 channels",
            channels == 3 && patch == patch_width && (1..=128).contains(&patch),
        )?;
        let positions = match self.layout {
            ClipLayout::PerceptionEncoder => self.shape::<3>(positions)?[1],
            _ => self.shape::<2>(positions)?[0],
        };
        let grid = positions.saturating_sub(1).isqrt();
        self.check(
            "positions",
            positions.to_string(),
            "one for the class, and those of a square of patches",
            positions <= MAX_TOKENS && grid > 0 && grid * grid + 1 == positions,
        )?;
        let [rows, columns] = self.shape(projection)?;
        let embedding = if self.layout == ClipLayout::OpenClip { columns } else { rows };
        self.check("embedding", embedding.to_string(), "1 to 4096 numbers", (1..=MAX_WIDTH).contains(&embedding))?;
        let image = self.tower("vision", width, &self.image_blocks())?;
        let prefix = self.layout.text_prefix(self.checkpoint);
        let (tokens, context) = match self.layout {
            ClipLayout::HuggingFace => (
                "text_model.embeddings.token_embedding.weight".to_owned(),
                "text_model.embeddings.position_embedding.weight".to_owned(),
            ),
            _ => (format!("{prefix}token_embedding.weight"), format!("{prefix}positional_embedding")),
        };
        let [vocabulary, text_width] = self.shape(&tokens)?;
        self.check("vocabulary", format!("{vocabulary} tokens"), "CLIP's 49408", vocabulary == ClipTokenizer::TOKENS)?;
        let [context, _] = self.shape(&context)?;
        self.check("context", format!("{context} tokens"), "3 to 1024", (3..=MAX_CONTEXT).contains(&context))?;
        let text = self.tower("text", text_width, &self.text_blocks())?;
        let pooling_heads = self.pooling_heads(width)?;
        let normalisation = self.normalisation();
        Ok(ClipConfig {
            layout: self.layout,
            image_size: grid * patch,
            patch,
            image,
            pooling_heads,
            text,
            context,
            embedding,
            normalisation,
            assumed: self.assumed,
        })
    }

    fn image_blocks(&self) -> BlockNames {
        match self.layout {
            ClipLayout::OpenClip => layout::open_clip_blocks("visual."),
            ClipLayout::HuggingFace => layout::hugging_face_blocks("vision_model."),
            ClipLayout::PerceptionEncoder => layout::timm_blocks("visual.trunk."),
        }
    }

    fn text_blocks(&self) -> BlockNames {
        let prefix = self.layout.text_prefix(self.checkpoint);
        match self.layout {
            ClipLayout::HuggingFace => layout::hugging_face_blocks(prefix),
            _ => layout::open_clip_blocks(prefix),
        }
    }

    fn tower(&mut self, tower: &str, width: usize, names: &BlockNames) -> Result<TowerConfig, ClipError> {
        self.check(
            &format!("width of the {tower} tower"),
            width.to_string(),
            "8 to 4096",
            (8..=MAX_WIDTH).contains(&width),
        )?;
        let blocks = names.count(self.checkpoint);
        self.check(
            &format!("blocks of the {tower} tower"),
            blocks.to_string(),
            "1 to 96",
            (1..=MAX_BLOCKS).contains(&blocks),
        )?;
        let heads = self.heads(tower, width)?;
        Ok(TowerConfig { width, heads, blocks, activation: self.activation(tower)? })
    }

    fn heads(&mut self, tower: &str, width: usize) -> Result<usize, ClipError> {
        let number = |key| self.given.as_ref()?.value(tower, key)?.as_u64();
        let count = number("num_attention_heads").or_else(|| number("heads"));
        let of_width = number("head_width").filter(|width| *width > 0).map(|head| width as u64 / head);
        let given = count.or(of_width);
        let heads = given.unwrap_or_else(|| usual_heads(tower, width) as u64);
        let is_possible = heads > 0 && (width as u64).is_multiple_of(heads);
        // The rotary encoding turns pairs of channels, half of them by the column and half by the row.
        let is_turned = self.layout == ClipLayout::PerceptionEncoder && tower == "vision";
        let is_possible = is_possible && (!is_turned || (width as u64 / heads).is_multiple_of(4));
        self.check(
            &format!("heads of the {tower} tower"),
            heads.to_string(),
            &format!("a divisor of {width}"),
            is_possible,
        )?;
        // A Perception Encoder has none but the usual number.
        if given.is_none() && self.layout != ClipLayout::PerceptionEncoder {
            self.assumed.push(format!("the {tower} tower has {heads} heads (put the network's config.json beside it)"));
        }
        Ok(heads as usize)
    }

    /// Heads of the attention pooling: 8 in every published Perception Encoder.
    fn pooling_heads(&self, width: usize) -> Result<usize, ClipError> {
        let given = self.given.as_ref().and_then(|given| given.value("vision", "attn_pool_num_heads")?.as_u64());
        let heads = given.unwrap_or(8);
        let is_used = self.layout == ClipLayout::PerceptionEncoder;
        self.check(
            "heads of the attention pooling",
            heads.to_string(),
            &format!("a divisor of {width}"),
            !is_used || heads > 0 && (width as u64).is_multiple_of(heads),
        )?;
        Ok(heads as usize)
    }

    fn activation(&mut self, tower: &str) -> Result<Activation, ClipError> {
        if self.layout == ClipLayout::PerceptionEncoder {
            return Ok(Activation::Gelu);
        }
        if let Some(given) = &self.given {
            let of_all = given.json.get("model_cfg").unwrap_or(&given.json).get("quick_gelu");
            return match (self.layout, given.value(tower, "hidden_act").and_then(Value::as_str)) {
                (ClipLayout::HuggingFace, None | Some("quick_gelu")) | (_, Some("quick_gelu")) => {
                    Ok(Activation::QuickGelu)
                }
                (_, Some("gelu")) => Ok(Activation::Gelu),
                (_, Some(other)) => Err(ClipError::Size {
                    path: given.path.clone(),
                    what: format!("hidden_act of the {tower} tower"),
                    found: printable(other),
                    expected: "gelu or quick_gelu".to_owned(),
                }),
                (_, None) if of_all.and_then(Value::as_bool) == Some(true) => Ok(Activation::QuickGelu),
                (_, None) => Ok(Activation::Gelu),
            };
        }
        let (activation, word) = match self.layout {
            ClipLayout::HuggingFace => (Activation::QuickGelu, "quick_gelu, as in OpenAI's networks"),
            _ => (Activation::Gelu, "gelu, as in OpenCLIP's own networks"),
        };
        let assumed = format!("the activation is {word} (put the network's config.json beside it)");
        if !self.assumed.contains(&assumed) {
            self.assumed.push(assumed);
        }
        Ok(activation)
    }

    fn normalisation(&self) -> [[f32; 3]; 2] {
        let usual = match self.layout {
            ClipLayout::PerceptionEncoder => HALVES,
            _ => OPENAI_NORMALISATION,
        };
        let given = self.given.as_ref().and_then(|given| given.json.get("preprocess_cfg"));
        let triple = |key: &str| -> Option<[f32; 3]> {
            let values: Vec<f32> =
                given?.get(key)?.as_array()?.iter().filter_map(|value| value.as_f64().map(|v| v as f32)).collect();
            values.try_into().ok()
        };
        match (triple("mean"), triple("std")) {
            (Some(mean), Some(deviation)) if deviation.iter().all(|value| *value > 1e-3) => [mean, deviation],
            _ => usual,
        }
    }

    /// The shape of a tensor with `N` axes.
    fn shape<const N: usize>(&self, name: &str) -> Result<[usize; N], ClipError> {
        let size = |found: String, expected: String| ClipError::Size {
            path: self.checkpoint.path().to_owned(),
            what: name.to_owned(),
            found,
            expected,
        };
        let info = self.checkpoint.info(name).ok_or_else(|| size("no such tensor".to_owned(), format!("{N} axes")))?;
        info.shape().try_into().map_err(|_| size(format!("shape {:?}", info.shape()), format!("{N} axes")))
    }

    fn check(&self, what: &str, found: String, expected: &str, is_right: bool) -> Result<(), ClipError> {
        if is_right {
            return Ok(());
        }
        let path = self.checkpoint.path().to_owned();
        Err(ClipError::Size { path, what: what.to_owned(), found, expected: expected.to_owned() })
    }
}

/// Heads of a tower of this width in the published networks.
fn usual_heads(tower: &str, width: usize) -> usize {
    if tower == "vision" && WIDE_TOWERS.contains(&width) { 16 } else { width / HEAD_WIDTH }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Widths and heads as in the configurations of open_clip: ViT-B, ViT-L, ViT-H/14, ViT-g/14, ViT-bigG/14.
    #[test]
    fn wide_image_towers_have_wide_heads() {
        let image = [(768, 12), (1024, 16), (1280, 16), (1408, 16), (1664, 16)];
        let text = [(512, 8), (768, 12), (1024, 16), (1280, 20)];
        assert!(image.iter().all(|(width, heads)| usual_heads("vision", *width) == *heads));
        assert!(text.iter().all(|(width, heads)| usual_heads("text", *width) == *heads));
    }
}

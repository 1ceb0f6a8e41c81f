//! The namer `clip`: it gives objects labels with a network for images and words.

use super::clip_names::{ClipNames, NamesError};
use crate::parts::{Namer, ObjectToName, Pacer, PartContext, PartError, PartFile, PartFiles, PartSection};
use splatseg_geometry::SegmentId;
use splatseg_objects::ObjectName;
use splatseg_settings::{Allowed, settings};
use std::error::Error;
use std::sync::Arc;

settings! {
    /// Settings of the namer `clip`.
    pub struct ClipNamerSettings in "clip" {
        /// Least probability of a label: an object without such a label has none. Smaller: more labels, and more wrong ones.
        min_score: f64 = ClipNames::MIN_SCORE, Allowed::between(0.0, 1.0);
        /// Share of all cores that naming may take while the frames of a live session are processed; the rest is named when the
        /// frames pause or have ended. 0: all is named when they have ended.
        cpu_share: f64 = 0.1, Allowed::between(0.0, 1.0);
    }
}

const NAMES: PartFile = PartFile {
    key: "names",
    help: "Checkpoint of a network for images and words, which names objects: a `.safetensors` of CLIP (OpenCLIP or \
           Hugging Face) or Perception Encoder Core. See docs/NAMES.md.",
    what: "a CLIP checkpoint, e.g. --names pe-core-s16.safetensors",
    called: "the file of --names",
    is_required: true,
    is_checkpoint: true,
};

const VOCABULARY: PartFile = PartFile {
    key: "vocabulary",
    help: "The labels that objects can get: a text or CSV file with a label in each line, then other words for it, with \
           commas between. By default about 670 household things.",
    what: "a text file with a label in each line, e.g. --vocabulary things.txt",
    called: "the file of --vocabulary",
    is_required: false,
    is_checkpoint: false,
};

impl PartSection<dyn Namer> for ClipNamerSettings {
    const NAME: &'static str = "clip";
    const HELP: &'static str = "A network for images and words: CLIP or Perception Encoder; needs --names";
    const FILES: &'static [PartFile] = &[NAMES, VOCABULARY];

    fn build(&self, files: &PartFiles, _: &PartContext<'_>) -> Result<Box<dyn Namer>, PartError> {
        let other = |source: NamesError| PartError::Other { name: "names".to_owned(), source: Box::new(source) };
        let names = ClipNames::open(files.required(&NAMES)?, files.get(&VOCABULARY)).map_err(other)?;
        let names = Arc::new(names.with_min_score(self.min_score));
        Ok(Box::new(ClipNamer { names, cpu_share: self.cpu_share }))
    }
}

/// A network with its share of the CPU.
struct ClipNamer {
    names: Arc<ClipNames>,
    cpu_share: f64,
}

impl Namer for Arc<ClipNames> {
    fn name(&self) -> &str {
        "clip"
    }

    fn name_object(&mut self, object: ObjectToName<'_>) -> Result<ObjectName, Box<dyn Error + Send + Sync>> {
        let embedding = self.embed_views(object.views)?;
        Ok(ObjectName { embedding, ..ObjectName::default() })
    }

    fn name_object_beside(
        &mut self,
        object: ObjectToName<'_>,
        pacer: &dyn Pacer,
    ) -> Result<ObjectName, Box<dyn Error + Send + Sync>> {
        let embedding = self.embed_views_in_steps(object.views, pacer)?;
        Ok(ObjectName { embedding, ..ObjectName::default() })
    }

    fn label_objects(
        &mut self,
        objects: &[(SegmentId, &[f32])],
    ) -> Result<Vec<(SegmentId, ObjectName)>, Box<dyn Error + Send + Sync>> {
        let embeddings: Vec<&[f32]> = objects.iter().map(|(_, embedding)| *embedding).collect();
        let labels = self.choose_labels(&embeddings)?;
        Ok(objects.iter().map(|(id, _)| *id).zip(labels).collect())
    }

    fn label_objects_beside(
        &mut self,
        objects: &[(SegmentId, &[f32])],
        pacer: &dyn Pacer,
    ) -> Result<Vec<(SegmentId, ObjectName)>, Box<dyn Error + Send + Sync>> {
        self.prepare_words_in_steps(pacer)?;
        self.label_objects(objects)
    }

    fn cpu_share(&self) -> Option<f64> {
        Some(ClipNamerSettings::default().cpu_share)
    }

    fn network(&self) -> Option<Arc<ClipNames>> {
        Some(Self::clone(self))
    }
}

impl Namer for ClipNamer {
    fn name(&self) -> &str {
        "clip"
    }

    fn name_object(&mut self, object: ObjectToName<'_>) -> Result<ObjectName, Box<dyn Error + Send + Sync>> {
        self.names.name_object(object)
    }

    fn name_object_beside(
        &mut self,
        object: ObjectToName<'_>,
        pacer: &dyn Pacer,
    ) -> Result<ObjectName, Box<dyn Error + Send + Sync>> {
        self.names.name_object_beside(object, pacer)
    }

    fn label_objects(
        &mut self,
        objects: &[(SegmentId, &[f32])],
    ) -> Result<Vec<(SegmentId, ObjectName)>, Box<dyn Error + Send + Sync>> {
        self.names.label_objects(objects)
    }

    fn label_objects_beside(
        &mut self,
        objects: &[(SegmentId, &[f32])],
        pacer: &dyn Pacer,
    ) -> Result<Vec<(SegmentId, ObjectName)>, Box<dyn Error + Send + Sync>> {
        self.names.label_objects_beside(objects, pacer)
    }

    fn cpu_share(&self) -> Option<f64> {
        Some(self.cpu_share)
    }

    fn network(&self) -> Option<Arc<ClipNames>> {
        Some(Arc::clone(&self.names))
    }
}

//! Names of objects, from your own function: see `docs/OBJECTS.md`.

use super::{Frames, Pipeline};
use splatseg_dataset::FrameSource;
use splatseg_geometry::{RemappedId, RgbdFrame, SegmentId};
use splatseg_objects::{
    KeptViews, NameError, Object, ObjectList, ObjectName, ObjectNames, ObjectSighting, ObjectState, ObjectView,
};
use splatseg_tracking::FrameOutput;
use std::collections::BTreeSet;
use std::error::Error;
use thiserror::Error;

/// An object to be named.
#[derive(Clone, Copy, Debug)]
pub struct ObjectToName<'a> {
    /// Its id, its present label, and its shape if it is known; without best view and confidence.
    pub object: &'a Object,
    /// Its best view, with sides of at most [`KeptViews::MAX_SIDE`] pixels.
    pub view: &'a ObjectView,
}

/// An error naming objects. Names given before it stay.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum NameObjectsError {
    /// The pipeline keeps no views.
    #[error("the pipeline keeps no views of objects: build it with keep_views")]
    NoViews,
    /// The function failed.
    #[error("naming object {id}: {source}")]
    Namer {
        /// The object.
        id: SegmentId,
        /// The function's error.
        source: Box<dyn Error + Send + Sync>,
    },
    /// The function has returned a name that cannot be used.
    #[error("the name of object {id}: {source}")]
    Name {
        /// The object.
        id: SegmentId,
        /// The error.
        source: NameError,
    },
}

/// Names, and the views that objects are named from.
#[derive(Default)]
pub(super) struct Naming {
    pub(super) names: ObjectNames,
    pub(super) views: Option<KeptViews>,
}

impl Naming {
    /// Ids turned out to be other ids' objects.
    pub(super) fn remap(&mut self, remapped: &[RemappedId]) {
        self.names.remap(remapped);
        if let Some(views) = &mut self.views {
            views.remap(remapped);
        }
    }

    /// Keeps the views of a frame, and forgets what the ids of new objects stood for.
    pub(super) fn record(&mut self, frame: &RgbdFrame, output: &FrameOutput, sightings: &[ObjectSighting]) {
        for id in &output.update.new_segments {
            self.names.forget(*id);
            if let Some(views) = &mut self.views {
                views.forget(*id);
            }
        }
        if let Some(views) = &mut self.views {
            views.record(frame.color(), &output.segments, sightings);
        }
    }
}

impl Pipeline {
    /// Names objects with your own function, e.g. a CLIP network: it gets the best view of an object so far and returns its
    /// label, its embedding, both or neither. It is called for each object without a name, and again for one whose best
    /// view has become clearly better, so it may be called after every frame. Objects that the memory has forgotten are
    /// left out. Returns the number of calls.
    ///
    /// Labels appear in [`Self::object_list`]; [`Self::save_memory`] saves them with the embeddings.
    ///
    /// # Errors
    /// [`NameObjectsError::NoViews`] without [`PipelineBuilder::keep_views`](super::PipelineBuilder::keep_views); an
    /// error of the function, or of a name that cannot be used.
    ///
    /// # Example
    /// A stand-in for a network, which knows two colours:
    /// ```
    /// use splatseg::dataset::{FrameStream, GroundTruth, open_scene};
    /// use splatseg::objects::ObjectName;
    /// use splatseg::{Pipeline, Settings};
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let settings = Settings::default();
    /// let scene = open_scene("synthetic:frames=3,width=96,height=72", &settings.dataset)?;
    /// let mut pipeline = Pipeline::builder(&settings).keep_views().build()?;
    /// for processed in pipeline.run(FrameStream::open(scene, &settings.dataset, GroundTruth::Skip)?) {
    ///     processed?.result?;
    /// }
    /// pipeline.name_objects(|object| {
    ///     let pixels = object.view.image.pixels().iter().zip(object.view.mask.pixels());
    ///     let (mut red, mut blue) = (0.0, 0.0);
    ///     for ([r, _, b], _) in pixels.filter(|(_, shows_object)| **shows_object) {
    ///         red += f32::from(*r);
    ///         blue += f32::from(*b);
    ///     }
    ///     let label = if red > blue { "red" } else { "blue" };
    ///     Ok(ObjectName { label: Some(label.to_owned()), embedding: vec![red, blue] })
    /// })?;
    /// let found = pipeline.find_label("red").len() + pipeline.find_label("blue").len();
    /// assert!(found > 0 && found == pipeline.find(&[1.0, 0.0])?.len());
    /// # Ok(())
    /// # }
    /// ```
    pub fn name_objects(
        &mut self,
        mut namer: impl FnMut(ObjectToName<'_>) -> Result<ObjectName, Box<dyn Error + Send + Sync>>,
    ) -> Result<usize, NameObjectsError> {
        let views = self.naming.views.as_ref().ok_or(NameObjectsError::NoViews)?;
        let is_carried = |id: &SegmentId| self.map().is_none_or(|map| map.is_carried(*id));
        let to_name: BTreeSet<SegmentId> = views.to_name(&self.naming.names).filter(is_carried).collect();
        // The list of objects takes milliseconds, and mostly there is nothing to name.
        if to_name.is_empty() {
            return Ok(0);
        }
        let objects = self.object_list().objects;
        let present = self.present();
        let Naming { names, views } = &mut self.naming;
        // Bounds the names of an endless stream: the log forgets objects too.
        names.keep_only(&objects.iter().map(|object| object.id).collect());
        if let Some(present) = present {
            names.keep_embeddings_of(&present);
        }
        let views = views.as_ref().ok_or(NameObjectsError::NoViews)?;
        let mut calls = 0;
        for object in objects.iter().filter(|object| object.state != Some(ObjectState::Forgotten)) {
            let id = object.id;
            let Some((view, score)) = views.view(id).filter(|_| to_name.contains(&id)) else { continue };
            let name = namer(ObjectToName { object, view }).map_err(|source| NameObjectsError::Namer { id, source })?;
            names.set(id, name, score).map_err(|source| NameObjectsError::Name { id, source })?;
            calls += 1;
        }
        Ok(calls)
    }

    /// The names of objects, given by [`Self::name_objects`] or loaded with the memory.
    pub const fn names(&self) -> &ObjectNames {
        &self.naming.names
    }

    /// Drops all names, e.g. before naming a loaded map with another network.
    pub fn clear_names(&mut self) {
        self.naming.names = ObjectNames::default();
    }

    /// The objects most similar to an embedding, with the similarity, as in [`ObjectNames::find`]; without objects that
    /// the memory has forgotten.
    ///
    /// # Errors
    /// If the embedding has a wrong length or numbers that are not finite.
    pub fn find(&self, embedding: &[f32]) -> Result<Vec<(SegmentId, f32)>, NameError> {
        let mut found = self.naming.names.find(embedding)?;
        if let Some(present) = self.present() {
            found.retain(|(id, _)| present.contains(id));
        }
        Ok(found)
    }

    /// The objects whose label contains the text, as in [`ObjectNames::find_label`]; without objects that the memory has
    /// forgotten.
    pub fn find_label(&self, text: &str) -> Vec<SegmentId> {
        let mut found = self.naming.names.find_label(text);
        if let Some(present) = self.present() {
            found.retain(|id| present.contains(id));
        }
        found
    }

    /// The objects seen so far or in the memory, with their labels. Confidences and best views are unknown until
    /// [`ObjectList::add_sightings`] is called.
    pub fn object_list(&self) -> ObjectList {
        let mut list = ObjectList::new(&self.objects, self.map());
        list.add_names(&self.naming.names);
        list
    }

    /// The names of the objects that the memory contains, as bytes; `None` without any.
    pub(super) fn saved_names(&self) -> Option<Vec<u8>> {
        let mut names = self.naming.names.clone();
        if let Some(present) = self.present() {
            names.keep_only(&present);
        }
        (!names.is_empty()).then(|| names.to_bytes())
    }

    /// The objects in the memory; `None` without a memory.
    fn present(&self) -> Option<BTreeSet<SegmentId>> {
        self.map().map(|map| map.carried_ids())
    }
}

impl<S: FrameSource> Frames<'_, S> {
    /// Names objects after the latest frame, as [`Pipeline::name_objects`].
    ///
    /// # Errors
    /// As [`Pipeline::name_objects`].
    pub fn name_objects(
        &mut self,
        namer: impl FnMut(ObjectToName<'_>) -> Result<ObjectName, Box<dyn Error + Send + Sync>>,
    ) -> Result<usize, NameObjectsError> {
        self.pipeline.name_objects(namer)
    }
}

//! Names of objects, from your own function: see `docs/OBJECTS.md`.

use super::kept_names::KeptNames;
use super::stages::in_thread_pool;
use super::{NameObjectsError, Pipeline};
use crate::parts::{Namer, ObjectToName};
use splatseg_geometry::SegmentId;
use splatseg_objects::{KeptViews, NameError, ObjectList, ObjectName, ObjectNames, ObjectState};
use std::collections::BTreeSet;
use std::error::Error;

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
    ///     Ok(ObjectName { label: Some(label.to_owned()), embedding: vec![red, blue], ..ObjectName::default() })
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
        let views = self.names.views.as_ref().ok_or(NameObjectsError::NoViews)?;
        let is_carried = |id: &SegmentId| self.map().is_none_or(|map| map.is_carried(*id));
        let to_name: BTreeSet<SegmentId> = views.to_name(&self.names.names).filter(is_carried).collect();
        // The list of objects takes milliseconds, and mostly there is nothing to name.
        if to_name.is_empty() {
            return Ok(0);
        }
        let list = self.object_list();
        let present = self.present();
        let KeptNames { names, views, .. } = &mut self.names;
        // Bounds the names of an endless stream: the log forgets objects too.
        names.keep_only(&list.all().map(|object| object.id).collect());
        if let Some(present) = present {
            names.keep_embeddings_of(&present);
        }
        let views = views.as_ref().ok_or(NameObjectsError::NoViews)?;
        let mut calls = 0;
        for object in list.all().filter(|object| object.state != Some(ObjectState::Forgotten)) {
            let id = object.id;
            let Some((view, score)) = views.view(id).filter(|_| to_name.contains(&id)) else { continue };
            let name = namer(ObjectToName { object, view }).map_err(|source| NameObjectsError::Namer { id, source })?;
            names.set(id, name, score).map_err(|source| NameObjectsError::Name { id, source })?;
            calls += 1;
        }
        Ok(calls)
    }

    /// Names objects with the namer that the settings chose, if there is one. A namer that is slow is used only here: call
    /// this after the last frame, or when the frames pause. Returns the number of objects that were named.
    ///
    /// # Errors
    /// As [`Self::name_objects`].
    pub fn finish_names(&mut self) -> Result<usize, NameObjectsError> {
        let Some(mut namer) = self.names.namer.take() else { return Ok(0) };
        let named = in_thread_pool(|| self.name_with(namer.as_mut()));
        self.names.namer = Some(namer);
        named
    }

    fn name_with(&mut self, namer: &mut dyn Namer) -> Result<usize, NameObjectsError> {
        let named = self.name_objects(|object| namer.name_object(object))?;
        if named > 0 {
            let names = &mut self.names.names;
            let objects: Vec<(SegmentId, &[f32])> = names.embeddings().collect();
            let labels = namer.label_objects(&objects).map_err(|source| NameObjectsError::Labels { source })?;
            for (id, name) in labels {
                names.relabel([(id, name)]).map_err(|source| NameObjectsError::Name { id, source })?;
            }
        }
        Ok(named)
    }

    /// Names objects after a frame, unless the namer is slow.
    pub(super) fn name_after_frame(&mut self) -> Result<(), NameObjectsError> {
        if self.names.namer.as_ref().is_some_and(|namer| !namer.is_slow()) {
            self.finish_names()?;
        }
        Ok(())
    }

    /// Gives an object the label of a person, or takes its label away with `None`. No namer replaces it.
    ///
    /// # Errors
    /// [`NameError`] if the label cannot be used.
    pub fn name_by_hand(&mut self, id: SegmentId, label: Option<&str>) -> Result<(), NameError> {
        self.names.names.set_by_hand(id, label)
    }

    /// Replaces the views that objects are named from, e.g. by those of frames that were decided again, and drops the names
    /// that a namer gave.
    pub fn set_views(&mut self, views: KeptViews) {
        self.names.names.keep_by_hand();
        self.names.views = Some(views);
    }

    /// True if the settings choose a namer.
    pub const fn has_namer(&self) -> bool {
        self.names.namer.is_some()
    }

    /// The names of objects, given by a namer or by [`Self::name_objects`], or loaded with the memory.
    pub const fn names(&self) -> &ObjectNames {
        &self.names.names
    }

    /// Drops all names, e.g. before naming a loaded map with another network.
    pub fn clear_names(&mut self) {
        self.names.names = ObjectNames::default();
    }

    /// The objects most similar to an embedding, with the similarity, as in [`ObjectNames::find`]; without objects that
    /// the memory has forgotten.
    ///
    /// # Errors
    /// If the embedding has a wrong length or numbers that are not finite.
    pub fn find(&self, embedding: &[f32]) -> Result<Vec<(SegmentId, f32)>, NameError> {
        let mut found = self.names.names.find(embedding)?;
        if let Some(present) = self.present() {
            found.retain(|(id, _)| present.contains(id));
        }
        Ok(found)
    }

    /// The objects whose label contains the text, as in [`ObjectNames::find_label`]; without objects that the memory has
    /// forgotten.
    pub fn find_label(&self, text: &str) -> Vec<SegmentId> {
        let mut found = self.names.names.find_label(text);
        if let Some(present) = self.present() {
            found.retain(|id| present.contains(id));
        }
        found
    }

    /// The objects seen so far or in the memory, with their labels. Confidences and best views are unknown until
    /// [`ObjectList::add_sightings`] is called.
    pub fn object_list(&self) -> ObjectList {
        let mut list = ObjectList::new(&self.objects, self.map());
        list.add_names(&self.names.names);
        list
    }

    /// The objects in the memory; `None` without a memory.
    fn present(&self) -> Option<BTreeSet<SegmentId>> {
        self.map().map(|map| map.carried_ids())
    }
}

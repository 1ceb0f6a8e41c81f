//! Names of objects, from your own function: see `docs/OBJECTS.md`.

use super::kept_names::KeptNames;
use super::naming_beside::{Job, Named, NamingBeside};
use super::stages::in_thread_pool;
use super::{NameObjectsError, Pipeline};
use crate::names::ClipNames;
use crate::parts::{Namer, ObjectToName};
use splatseg_geometry::SegmentId;
use splatseg_objects::{KeptViews, NameError, Object, ObjectList, ObjectName, ObjectNames, ObjectState};
use std::cmp::Reverse;
use std::collections::BTreeSet;
use std::error::Error;
use std::io;
use std::sync::{Arc, PoisonError};

impl Pipeline {
    /// Names objects with your own function, e.g. a CLIP network: it gets the best views of an object so far and returns its
    /// label, its embedding, both or neither. It is called for each object without a name, and again for one whose best
    /// views have become clearly better, so it may be called after every frame. Objects that the memory has forgotten are
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
        let to_name: BTreeSet<SegmentId> = self.to_name(views).into_iter().collect();
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
            let Some(score) = views.score(id).filter(|_| to_name.contains(&id)) else { continue };
            let views = views.views(id);
            let Some((view, _)) = views.first() else { continue };
            let name = namer(ObjectToName { object, view, views: &views })
                .map_err(|source| NameObjectsError::Namer { id, source })?;
            names.set(id, name, score).map_err(|source| NameObjectsError::Name { id, source })?;
            calls += 1;
        }
        Ok(calls)
    }

    /// Names objects with the namer that the settings chose, if there is one: all that need it, at once, on all cores. Call
    /// this after the last frame. Returns the number of objects that were named.
    ///
    /// # Errors
    /// As [`Self::name_objects`].
    pub fn finish_names(&mut self) -> Result<usize, NameObjectsError> {
        self.take_names_from_beside(true);
        let Some(namer) = self.names.namer.clone() else { return Ok(0) };
        let mut namer = namer.lock().unwrap_or_else(PoisonError::into_inner);
        self.name_with(namer.as_mut())
    }

    /// Names objects with a namer, as [`Self::name_objects`] does with a function, and then chooses labels for all of them
    /// together if the namer does so.
    ///
    /// # Errors
    /// As [`Self::name_objects`].
    pub fn name_with(&mut self, namer: &mut dyn Namer) -> Result<usize, NameObjectsError> {
        in_thread_pool(|| self.name_and_label(namer))
    }

    fn name_and_label(&mut self, namer: &mut dyn Namer) -> Result<usize, NameObjectsError> {
        let named = self.name_objects(|object| namer.name_object(object))?;
        if named > 0 || self.names.is_unlabelled {
            let names = &mut self.names.names;
            let objects: Vec<(SegmentId, &[f32])> = names.embeddings().collect();
            let labels = namer.label_objects(&objects).map_err(|source| NameObjectsError::Labels { source })?;
            for (id, name) in labels {
                names.relabel([(id, name)]).map_err(|source| NameObjectsError::Name { id, source })?;
            }
            self.names.is_unlabelled = false;
        }
        Ok(named)
    }

    /// Names objects after a frame, or beside it if the namer is slow.
    pub(super) fn name_after_frame(&mut self) -> Result<(), NameObjectsError> {
        if self.names.cpu_share.is_none() {
            self.finish_names()?;
        } else {
            self.name_beside(false);
        }
        Ok(())
    }

    /// Lets a slow namer work beside the frames from now on, on a thread of its own, within its
    /// [share of the CPU](Namer::cpu_share). Does nothing with another namer, without one, or if the share is 0.
    ///
    /// Which objects have names after a frame then depends on the time. [`Self::finish_names`] names those that are left.
    ///
    /// # Errors
    /// If the system allows no more threads.
    pub fn name_beside_frames(&mut self) -> io::Result<()> {
        if let (Some(namer), Some(share)) = (&self.names.namer, self.names.cpu_share)
            && share > 0.0
        {
            self.names.beside = Some(NamingBeside::start(Arc::clone(namer), share)?);
        }
        Ok(())
    }

    /// Gives a thread that names beside the frames the next object without a rest, as no frames come. Does not wait.
    /// Returns true if a name has come.
    pub fn name_while_idle(&mut self) -> bool {
        self.name_beside(true)
    }

    fn name_beside(&mut self, is_idle: bool) -> bool {
        let has_name = self.take_names_from_beside(false);
        let Some(beside) = self.names.beside.as_ref().filter(|beside| beside.is_free(is_idle)) else { return has_name };
        let is_late = self.names.is_unlabelled && beside.is_time_for_labels();
        let id = if is_late { None } else { self.next_to_name() };
        let job = match id.and_then(|id| self.naming_job(id)) {
            Some(job) => Some(job),
            None => self.names.is_unlabelled.then(|| self.labels_job()),
        };
        if let (Some(job), Some(beside)) = (job, &mut self.names.beside) {
            beside.give(job);
        }
        has_name
    }

    /// Of the objects that need a name, the one seen last.
    fn next_to_name(&self) -> Option<SegmentId> {
        let views = self.names.views.as_ref()?;
        self.to_name(views).into_iter().max_by_key(|id| (views.last_frame(*id), Reverse(*id)))
    }

    /// The objects of the map that need a name.
    fn to_name(&self, views: &KeptViews) -> Vec<SegmentId> {
        let ids: Vec<SegmentId> = views.to_name(&self.names.names).collect();
        match self.map() {
            Some(map) if !ids.is_empty() => map.segments.carried_of(ids),
            _ => ids,
        }
    }

    fn naming_job(&self, id: SegmentId) -> Option<Job> {
        let views = self.names.views.as_ref()?;
        let copies = views.views(id).into_iter().map(|(view, weight)| (view.clone(), weight)).collect();
        let object = Object { label: self.names.names.label(id).map(str::to_owned), ..Object::unknown(id) };
        Some(Job::Object(Box::new(object), copies, views.score(id)?))
    }

    /// Labels for all objects that are still there.
    fn labels_job(&mut self) -> Job {
        let present = self.present();
        let logged = self.objects.records().keys().copied();
        let known = present.iter().flatten().copied().chain(logged).collect();
        let KeptNames { names, is_unlabelled, .. } = &mut self.names;
        // Bounds the names of an endless stream: the log forgets objects too.
        names.keep_only(&known);
        if let Some(present) = present {
            names.keep_embeddings_of(&present);
        }
        *is_unlabelled = false;
        Job::Labels(names.embeddings().map(|(id, embedding)| (id, embedding.to_vec())).collect())
    }

    /// Takes over what the thread beside the frames has done. Returns true if that changes a name. Its first error ends it:
    /// [`Self::finish_names`] then meets the same one, and returns it.
    fn take_names_from_beside(&mut self, wait: bool) -> bool {
        let KeptNames { names, beside, is_unlabelled, .. } = &mut self.names;
        let taken = match beside.as_mut().and_then(|beside| beside.take(wait)) {
            None => return false,
            Some(Err(error)) => Err(error.to_string()),
            Some(Ok(Named::Object(id, name, score))) => {
                *is_unlabelled = true;
                names.set(id, name, score).map_err(|error| error.to_string())
            }
            Some(Ok(Named::Labels(labels))) => names.relabel(labels).map_err(|error| error.to_string()),
        };
        if let Err(error) = taken {
            tracing::warn!("no more objects are named until the end: {error}");
            *beside = None;
            return false;
        }
        true
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

    /// The network for images and words with which objects are named, if there is one: for
    /// [`find_objects`](crate::names::find_objects).
    pub fn names_network(&self) -> Option<Arc<ClipNames>> {
        self.names.network.clone()
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

    /// The objects seen so far or in the memory, with their labels, and when they were seen. Confidences and best views are unknown until
    /// [`ObjectList::add_sightings`] is called.
    pub fn object_list(&self) -> ObjectList {
        self.described(ObjectList::new(&self.objects, self.map()))
    }

    /// A list of this pipeline's objects with their labels, and when they were seen.
    pub(super) fn described(&self, mut list: ObjectList) -> ObjectList {
        list.add_names(&self.names.names);
        list.add_seen_times(&self.history.seen());
        list
    }

    /// The objects in the memory; `None` without a memory.
    fn present(&self) -> Option<BTreeSet<SegmentId>> {
        self.map().map(|map| map.carried_ids())
    }
}

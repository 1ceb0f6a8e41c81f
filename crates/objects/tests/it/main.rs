//! The integration tests of this crate, in one program: it is linked once.

mod kept_views;
mod labelled_rooms;
mod names;
mod object_list;
mod relations;
mod seen_room;
mod synthetic_room;

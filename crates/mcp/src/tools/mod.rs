//! The tools, one in each file.

mod find_objects;
mod list_objects;
mod list_rooms;
mod name_object;
mod name_room;
mod picture_of;
mod plan_view;
mod route;
mod what_changed;
mod what_is_near;
mod where_is;

use crate::tool::ToolEntry;

/// The tools of a map, in the order in which clients list them. Those that write are left out unless that is
/// allowed. Those that need rooms are always there: the next version of the map's file may have them.
pub fn all(allow_write: bool) -> Vec<ToolEntry> {
    let tools = [
        ToolEntry::of::<list_objects::ListObjects>(),
        ToolEntry::of::<find_objects::FindObjects>(),
        ToolEntry::of::<where_is::WhereIs>(),
        ToolEntry::of::<what_is_near::WhatIsNear>(),
        ToolEntry::of::<what_changed::WhatChanged>(),
        ToolEntry::of::<picture_of::PictureOf>(),
        ToolEntry::of::<plan_view::PlanView>(),
        ToolEntry::of::<list_rooms::ListRooms>(),
        ToolEntry::of::<route::Route>(),
        ToolEntry::of::<name_object::NameObject>(),
        ToolEntry::of::<name_room::NameRoom>(),
    ];
    tools.into_iter().filter(|tool| allow_write || !tool.writes).collect()
}

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

/// The tools of a map, in the order in which clients list them. Those that write, or need free space, are left out where
/// they could not work.
pub fn all(allow_write: bool, has_places: bool) -> Vec<ToolEntry> {
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
    let can_work = |tool: &ToolEntry| (allow_write || !tool.writes) && (has_places || !tool.needs_places);
    tools.into_iter().filter(can_work).collect()
}

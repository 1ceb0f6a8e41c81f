//! Images inside zip and tar.gz files, read without unpacking the archive to a folder.

mod tarred;
mod zipped;

pub(crate) use tarred::{MemberFlow, UnpackedMembers, for_each_member};
pub(crate) use zipped::ZippedImages;

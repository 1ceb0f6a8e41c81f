//! A server as its viewers see it, through sockets on 127.0.0.1.

mod access;
mod client;
mod damaged_input;
mod foxglove;
mod page;
mod slow_viewers;

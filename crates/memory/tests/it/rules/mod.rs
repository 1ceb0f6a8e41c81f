//! The rules of the memory, each on a small scene whose truth is known: a rule that breaks fails here by its name.

mod bad_input;
mod coarseness;
mod contradictions;
mod coordinates;
mod evidence;
mod features;
mod growth;
mod ids;
mod limit;
mod removal;
mod run;
mod scene;
mod still_and_round;
mod threads;
mod votes;

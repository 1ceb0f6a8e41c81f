//! Documents against the code, in one program.

mod dependencies_document;
mod links;
mod paper_document;
mod results_document;
mod site;

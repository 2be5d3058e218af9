//! Texts that users write: bounded reading of their files, errors with file, line, column and remedy, suggestions for
//! mistyped names, printable output, and XML as a tree with locations.

pub mod error;
pub mod file;
mod printable;
mod spelling;
pub mod xml;

pub use error::{Excerpt, FileError, Loaded, SourceText};
pub use printable::{digits, hidden_in, is_hidden, printable, readable};
pub use spelling::{nearest, suggestion};

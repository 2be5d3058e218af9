//! Locators: world positions of objects from the detections of both eyes (paper, section 3.2).
//!
//! ```text
//! CSV ──> rows ──> known views ──> triangulated, network, ensemble, calibrated ──> file
//! view ──> origins x explanations x expectations ──> mean, covariance ──> tracker
//! ```
//!
//! Units: meters, radians, pixels; millimeters and degrees only in recorded tables.

pub mod beginning;
pub mod calibrated;
pub mod ensemble;
pub mod file;
mod fit;
pub mod folds;
pub mod head;
mod honest;
pub mod kinds;
pub mod learned;
pub mod lens;
mod looking;
pub mod model;
pub mod network;
pub mod noise;
pub mod online;
mod pairing;
pub mod parameters;
pub mod posterior;
mod rigid;
pub mod rows;
pub mod score;
pub mod standing;
#[cfg(test)]
mod tests;
mod together;
pub mod tracker;
pub mod triangulated;
pub mod view;
pub mod workspace;

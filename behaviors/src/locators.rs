//! Locators: where in the world is what both eyes saw (paper, section 3.2).
//!
//! ```text
//! CSV ──> rows ──> known views ──> calibrated, network, .. ──> file
//! view ──> origins x explanations x expectations ──> mean, covariance ──> tracker
//! ```
//!
//! Units: meters, radians, pixels; millimeters and degrees only in recorded tables.

pub mod calibrated;
mod fit;
pub mod folds;
pub mod head;
pub mod lens;
pub mod model;
pub mod noise;
pub mod posterior;
mod rigid;
pub mod rows;
#[cfg(test)]
mod tests;
pub mod view;
pub mod workspace;

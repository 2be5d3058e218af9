//! Images on walls.

use super::solid::V3;
use super::texture::Texture;
use mobee_contract::KindError;
use mobee_contract::picture::{PictureFault, list_paths, read};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use std::path::{Path, PathBuf};

/// Draws images for walls from a file or a folder.
///
/// # Errors
/// There are none, or one that is drawn is broken.
pub fn textures(path: &Path, count: usize, rng: &mut ChaCha8Rng) -> Result<Vec<Texture>, KindError> {
    let wrong = |e: PictureFault| KindError::new("pictures", e.to_string(), e.help);
    let files = match path.is_dir() {
        true => list_paths(path).map_err(wrong)?,
        false => vec![path.to_owned()],
    };
    let mut draw = || files.get(rng.random_range(0..files.len()));
    let drawn: Vec<&PathBuf> = (0..count).filter_map(|_| draw()).collect();
    let texture = |p: &PathBuf| {
        let picture = read(p)?;
        let (width, height) = picture.dimensions();
        let color = |u: f32, v: f32| {
            let at = |share: f32, n: u32| ((share * n as f32) as u32).min(n.saturating_sub(1));
            let [r, g, b] = picture.get_pixel(at(u, width), at(v, height)).0;
            V3::new(f32::from(r), f32::from(g), f32::from(b))
        };
        Ok(Texture::sampled(9, color))
    };
    drawn.into_iter().map(texture).collect::<Result<_, _>>().map_err(wrong)
}

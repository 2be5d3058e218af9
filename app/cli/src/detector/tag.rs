//! `mobee detector tag`: images of tags.

use image::RgbImage;
use miette::Report;
use mobee_compose::config::ConfigError;
use mobee_sensing::detectors::tag::TagFamilyName;
use std::path::PathBuf;

/// Arguments of `mobee detector tag`.
#[derive(clap::Args, Clone, Debug)]
pub struct TagArgs {
    /// The tag's number in its family.
    #[arg(long, value_name = "N")]
    id: u16,
    /// The family: 36h11, 25h9 or 16h5.
    #[arg(long, default_value = "36h11", value_parser = family)]
    family: TagFamilyName,
    /// The edge of one bit, pixels.
    #[arg(long, value_name = "N", default_value_t = 40)]
    pixels: usize,
    /// The file to write, a PNG; an existing one is not replaced.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

fn family(name: &str) -> Result<TagFamilyName, String> {
    let known = TagFamilyName::ALL.into_iter().find(|f| f.name() == name);
    known.ok_or_else(|| "give 36h11, 25h9 or 16h5".into())
}

/// Writes the image, and returns the size at which it must be printed.
///
/// # Errors
/// If the family has no such tag, or the image can't be written.
pub fn command(args: &TagArgs) -> Result<String, Report> {
    let name = args.family.name();
    let count = args.family.count();
    if args.id >= count {
        let help = format!("give a number from 0 to {}", count - 1);
        return Err(ConfigError::plain(format!("the family {name} has no tag {}", args.id), help).into());
    }
    let picture = args.family.picture(args.id, args.pixels).ok_or_else(|| {
        ConfigError::plain(format!("bits of {} pixels make no picture", args.pixels), "give 1 to 400 for --pixels")
    })?;
    let at = args.out.display();
    let fail = |e: String| {
        ConfigError::plain(
            format!("can't write {at}: {e}"),
            "give a file NAME.png that is not there, in a folder that is",
        )
    };
    if args.out.extension().is_none_or(|e| !e.eq_ignore_ascii_case("png")) {
        return Err(fail("its name does not end in .png".into()).into());
    }
    let width = picture.width as u32;
    let height = picture.height as u32;
    let image =
        RgbImage::from_raw(width, height, picture.rgb).ok_or_else(|| fail("the picture is not whole".into()))?;
    let mut file = std::fs::File::create_new(&args.out).map_err(|e| fail(e.to_string()))?;
    image.write_to(&mut file, image::ImageFormat::Png).map_err(|e| fail(e.to_string()))?;
    Ok(format!(
        "{at}: tag {} of {name}, {width}x{height} pixels. For a tag of `size_m` = 0.06, which is its black border, print it {:.1} mm wide, or \
         give a sticker `width_m` = {}\n",
        args.id,
        60.0 * args.family.edge_of_picture(),
        0.06 * args.family.edge_of_picture(),
    ))
}

//! Image and mask files are read as people see them, in training and evaluation alike: upright,
//! with any channels and any spelling of their names.

use image::{DynamicImage, GrayImage, ImageBuffer, ImageFormat, Luma, LumaA, Rgb, RgbImage, Rgba};
use mobee_sensing::detectors::picture::{read_folder, read_mask, read_picture, read_pictures};
use std::io::Cursor;
use std::path::{Path, PathBuf};

const SIZE: [u32; 2] = [24, 16];

/// The object: without any symmetry.
fn is_object(x: u32, y: u32) -> bool {
    (3..9).contains(&x) && (2..11).contains(&y) || (9..20).contains(&x) && (2..5).contains(&y)
}

fn picture() -> RgbImage {
    RgbImage::from_fn(SIZE[0], SIZE[1], |x, y| if is_object(x, y) { Rgb([200, 40, 40]) } else { Rgb([60, 120, 70]) })
}

fn save(path: &Path, image: impl Into<DynamicImage>) {
    image.into().save(path).expect("saved");
}

/// Creates the file of an image that is stored rotated, with the EXIF entry that turns it upright.
fn stored_turned(upright: &RgbImage, orientation: u8, format: ImageFormat) -> Vec<u8> {
    let image = DynamicImage::from(upright.clone());
    let stored = match orientation {
        2 => image.fliph(),
        3 => image.rotate180(),
        4 => image.flipv(),
        5 => image.rotate90().fliph(),
        6 => image.rotate270(),
        7 => image.rotate270().fliph(),
        8 => image.rotate90(),
        _ => image,
    };
    let mut file = Cursor::new(Vec::new());
    stored.write_to(&mut file, format).expect("encoded");
    let (file, tiff) = (file.into_inner(), tiff(orientation));
    match format {
        ImageFormat::Jpeg => {
            let mut exif = b"Exif\0\0".to_vec();
            exif.extend(&tiff);
            let length = (exif.len() as u16 + 2).to_be_bytes();
            [&file[..2], &[0xff, 0xe1], &length, &exif, &file[2..]].concat()
        }
        _ => {
            // After the header: a chunk eXIf.
            let chunk = [&b"eXIf"[..], &tiff].concat();
            let (length, sum) = ((tiff.len() as u32).to_be_bytes(), crc(&chunk).to_be_bytes());
            [&file[..33], &length, &chunk, &sum, &file[33..]].concat()
        }
    }
}

fn tiff(orientation: u8) -> Vec<u8> {
    let entry = [0x12, 0x01, 3, 0, 1, 0, 0, 0, orientation, 0, 0, 0];
    [&b"II*\0\x08\0\0\0\x01\0"[..], &entry, &[0; 4]].concat()
}

fn crc(bytes: &[u8]) -> u32 {
    let step = |sum: u32, _: u32| if sum & 1 == 1 { sum >> 1 ^ 0xedb8_8320 } else { sum >> 1 };
    !bytes.iter().fold(!0, |sum, b| (0..8).fold(sum ^ u32::from(*b), step))
}

#[test]
fn pictures_are_turned_upright() {
    let dir = tempfile::tempdir().expect("a folder");
    let upright = picture();
    for format in [ImageFormat::Jpeg, ImageFormat::Png] {
        for orientation in 1..=8 {
            let path = dir.path().join("stored");
            std::fs::write(&path, stored_turned(&upright, orientation, format)).expect("written");
            let read = read_picture(&path).expect("a picture");
            assert_eq!([read.width, read.height], SIZE.map(|n| n as usize), "{format:?} {orientation}");
            assert_eq!(mobee_contract::picture::size(&path), Ok(SIZE), "{format:?} {orientation}");
            let off = |(x, y, p): (u32, u32, &Rgb<u8>)| {
                let at = ((y * SIZE[0] + x) * 3) as usize;
                p.0.iter().zip(&read.rgb[at..at + 3]).map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>()
            };
            let mean = upright.enumerate_pixels().map(off).sum::<f64>() / f64::from(3 * SIZE[0] * SIZE[1]);
            assert!(mean < 6.0, "{format:?} {orientation}: off by {mean} in the mean");
        }
    }
}

#[test]
fn torn_files_are_no_pictures() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("a.jpg");
    for format in [ImageFormat::Jpeg, ImageFormat::Png] {
        let whole = stored_turned(&picture(), 6, format);
        std::fs::write(&path, &whole).expect("written");
        read_picture(&path).expect("it is whole");
        // Data that cameras append is harmless.
        std::fs::write(&path, [&whole[..], b"and more"].concat()).expect("written");
        read_picture(&path).expect("it is whole");
        for share in [3, 6, 8] {
            std::fs::write(&path, &whole[..whole.len() * share / 10]).expect("written");
            let fault = read_picture(&path).expect_err("it is torn");
            assert!(fault.what.contains("no whole picture"), "{format:?}, {share}: {fault:?}");
        }
    }
}

#[test]
fn pictures_of_any_channels_show_what_people_see() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("a.png");
    let first = |image: DynamicImage| {
        save(&path, image);
        let [r, g, b] = read_picture(&path).expect("a picture").rgb[..3] else { panic!("no pixel") };
        [r, g, b]
    };
    let deep = ImageBuffer::from_pixel(4, 4, Rgb([65535u16, 32896, 257]));
    assert_eq!(first(deep.into()), [255, 128, 1]);
    assert_eq!(first(ImageBuffer::from_pixel(4, 4, Luma([25700u16])).into()), [100; 3]);
    assert_eq!(first(ImageBuffer::from_pixel(4, 4, LumaA([90u8, 255])).into()), [90; 3]);
    // Transparent pixels are shown as white paper, not in their invisible color.
    assert_eq!(first(ImageBuffer::from_pixel(4, 4, LumaA([0u8, 0])).into()), [255; 3]);
    assert_eq!(first(ImageBuffer::from_pixel(4, 4, Rgba([255u8, 0, 0, 51])).into()), [255, 204, 204]);
}

/// Creates an indexed PNG of 8 bits with the index of a color for each pixel.
fn indexed(path: &Path, colors: &[[u8; 3]], alphas: &[u8], index: impl Fn(u32, u32) -> u8) {
    let chunk = |kind: &[u8; 4], data: &[u8]| {
        let body = [&kind[..], data].concat();
        [&(data.len() as u32).to_be_bytes()[..], &body, &crc(&body).to_be_bytes()].concat()
    };
    let rows: Vec<u8> = (0..SIZE[1])
        .flat_map(|y| std::iter::once(0).chain((0..SIZE[0]).map(move |x| (x, y)).map(|(x, y)| index(x, y))))
        .collect();
    // Deflate without compression.
    let length = (rows.len() as u16).to_le_bytes();
    let (mut a, mut b) = (1u32, 0u32);
    for byte in &rows {
        a = (a + u32::from(*byte)) % 65521;
        b = (b + a) % 65521;
    }
    let sum = (b << 16 | a).to_be_bytes();
    let data = [&[0x78, 0x01, 0x01][..], &length, &[!length[0], !length[1]], &rows, &sum].concat();
    let head = [&SIZE[0].to_be_bytes()[..], &SIZE[1].to_be_bytes(), &[8, 3, 0, 0, 0]].concat();
    let mut file = [&b"\x89PNG\r\n\x1a\n"[..], &chunk(b"IHDR", &head), &chunk(b"PLTE", &colors.concat())].concat();
    if !alphas.is_empty() {
        file.extend(chunk(b"tRNS", alphas));
    }
    file.extend([chunk(b"IDAT", &data), chunk(b"IEND", b"")].concat());
    std::fs::write(path, file).expect("written");
}

#[test]
fn masks_of_any_kind_show_the_object() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("m.png");
    let truth: Vec<bool> = (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| is_object(x, y))).collect();
    let shows = |what: &str| {
        let mask = read_mask(&path).unwrap_or_else(|e| panic!("{what}: {e}"));
        assert_eq!(mask.data, truth, "{what}");
    };
    let [w, h] = SIZE;
    let choose = |x, y, object: u8, ground: u8| if is_object(x, y) { object } else { ground };
    for (object, ground) in [(255, 0), (1, 0), (38, 0), (128, 0), (255, 30)] {
        save(&path, GrayImage::from_fn(w, h, |x, y| Luma([choose(x, y, object, ground)])));
        shows(&format!("gray {object} on {ground}"));
    }
    save(&path, ImageBuffer::from_fn(w, h, |x, y| Luma([u16::from(is_object(x, y))])));
    shows("labels of 16 bits");
    save(&path, ImageBuffer::from_fn(w, h, |x, y| LumaA([choose(x, y, 255, 0), 255u8])));
    shows("gray with alpha that says nothing");
    save(&path, ImageBuffer::from_fn(w, h, |x, y| LumaA([0u8, choose(x, y, 255, 0)])));
    shows("black on transparent");
    save(&path, ImageBuffer::from_fn(w, h, |x, y| Rgba([(x * 9) as u8, 20, (y * 11) as u8, choose(x, y, 255, 0)])));
    shows("the object cut out of its picture");
    save(&path, RgbImage::from_fn(w, h, |x, y| if is_object(x, y) { Rgb([0, 0, 128]) } else { Rgb([0; 3]) }));
    shows("blue on black");
    save(&path, RgbImage::from_fn(w, h, |x, y| if is_object(x, y) { Rgb([253, 231, 37]) } else { Rgb([68, 1, 84]) }));
    shows("a color map's ends");
    indexed(&path, &[[0; 3], [128, 0, 0]], &[], |x, y| u8::from(is_object(x, y)));
    shows("a palette with dark red");
    indexed(&path, &[[0; 3], [128, 0, 0]], &[0], |x, y| u8::from(is_object(x, y)));
    shows("a palette with a transparent ground");
    // Soft edges: the border is at half the brightness.
    let soft =
        |x: u32, y: u32| if is_object(x, y) { 180 + ((x * 7 + y * 3) % 60) as u8 } else { ((x * 5 + y) % 40) as u8 };
    save(&path, GrayImage::from_fn(w, h, |x, y| Luma([soft(x, y)])));
    shows("noise and soft edges");
    save(&path, GrayImage::new(w, h));
    assert!(read_mask(&path).expect("a mask").data.iter().all(|m| !m), "the object is not in the picture");
}

#[test]
fn masks_that_leave_it_open_are_refused() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("m.png");
    let refused = |said: &str| {
        let fault = read_mask(&path).expect_err(said);
        assert!(fault.what.contains(said) && !fault.help.is_empty(), "{fault:?}");
    };
    let [w, h] = SIZE;
    let other = |x: u32, y: u32| (12..18).contains(&x) && (9..15).contains(&y);
    let label = |x, y| if is_object(x, y) { 1 } else { 2 * u8::from(other(x, y)) };
    save(&path, GrayImage::from_fn(w, h, |x, y| Luma([label(x, y)])));
    refused("2 colors that could be the object: gray 1, gray 2");
    indexed(&path, &[[0; 3], [128, 0, 0], [0, 128, 0]], &[], label);
    refused("(0, 128, 0), (128, 0, 0)");
    save(&path, GrayImage::from_fn(w, h, |x, y| Luma([[0, 255, 1][usize::from(label(x, y))]])));
    refused("gray 1, gray 255");
    save(
        &path,
        ImageBuffer::from_fn(w, h, |x, y| {
            LumaA([[0, 255, 0][usize::from(label(x, y))], 255 * u8::from(label(x, y) < 2)])
        }),
    );
    refused("transparent, black and white");
    save(&path, ImageBuffer::from_pixel(w, h, LumaA([255u8, 0])));
    refused("all of this mask is transparent");
}

#[test]
fn names_may_be_in_capitals_and_what_is_no_picture_is_named() {
    let dir = tempfile::tempdir().expect("a folder");
    let at = |name: &str| -> PathBuf { dir.path().join(name) };
    let mask = GrayImage::from_fn(SIZE[0], SIZE[1], |x, y| Luma([255 * u8::from(is_object(x, y))]));
    for (name, of, format) in [
        ("IMG_1.JPG", "IMG_1_mask.png", ImageFormat::Jpeg),
        ("b.PNG", "b_MASK.PNG", ImageFormat::Png),
        ("c.Jpeg", "c_Mask.png", ImageFormat::Jpeg),
    ] {
        picture().save_with_format(at(name), format).expect("saved");
        mask.save_with_format(at(of), ImageFormat::Png).expect("saved");
    }
    std::fs::write(at(".hidden.jpg"), "not seen").expect("written");
    std::fs::write(at("notes.txt"), "not a picture").expect("written");
    let names: Vec<String> = read_folder(dir.path()).expect("whole").into_iter().map(|p| p.name).collect();
    assert_eq!(names, ["IMG_1", "b", "c"]);
    let refused = |file: &str, said: &str| {
        let fault = read_pictures(dir.path()).expect_err(said);
        assert!(fault.path.ends_with(file) && fault.what.contains(said) && !fault.help.is_empty(), "{fault:?}");
        std::fs::remove_file(at(file)).expect("removed");
    };
    std::fs::write(at("scan.tiff"), "II*").expect("written");
    refused("scan.tiff", "pictures of this format");
    std::fs::copy(at("IMG_1.JPG"), at("b_mask.jpg")).expect("copied");
    refused("b_mask.jpg", "this mask is no PNG");
    std::fs::copy(at("b_MASK.PNG"), at("b_mask.png")).expect("copied");
    refused("b_mask.png", "another mask");
    std::fs::copy(at("b_MASK.PNG"), at("d_mask.PNG")).expect("copied");
    refused("d_mask.PNG", "no picture");
    assert_eq!(read_pictures(dir.path()).expect("whole").len(), 3);
}

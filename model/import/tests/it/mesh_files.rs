//! Mesh files in the variants that programs write: all contents of a file are read, or the file is rejected with the
//! location, never read in part.

use mobee_import::{UrdfOptions, load_mesh, load_surfaces};

use mobee_model::{FileError, Mesh};

/// Two triangles, the second five meters beside the first.
const BOTH: (usize, [f64; 3], [f64; 3]) = (2, [0.0, 0.0, 0.0], [6.0, 1.0, 0.0]);

fn load(name: &str, bytes: &[u8]) -> Result<Mesh, FileError> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    load_mesh(path)
}

fn extent(mesh: &Mesh) -> (usize, [f64; 3], [f64; 3]) {
    let round = |c: f64| (c * 1e6).round() / 1e6 + 0.0;
    let edge = |f: fn(f64, f64) -> f64| [0, 1, 2].map(|i| round(mesh.vertices.iter().map(|v| v[i]).reduce(f).unwrap()));
    (mesh.triangles.len(), edge(f64::min), edge(f64::max))
}

/// All variants are read as both triangles.
fn all_are_read(extension: &str, files: &[(&str, Vec<u8>)]) {
    let wrong: Vec<String> = files
        .iter()
        .filter_map(|(what, bytes)| match load(&format!("m.{extension}"), bytes) {
            Ok(mesh) if extent(&mesh) == BOTH => None,
            Ok(mesh) => Some(format!("{what}: {:?}", extent(&mesh))),
            Err(e) => Some(format!("{what}: {e}")),
        })
        .collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// All variants are rejected with this message, and the remedy does not suggest to search for the file.
fn all_are_refused(extension: &str, files: &[(&str, Vec<u8>)]) {
    for (expected, bytes) in files {
        let error = load(&format!("m.{extension}"), bytes).expect_err(expected);
        assert!(error.message().contains(expected), "{expected}: {error}");
        assert!(!error.remedy().contains("--meshes") && error.remedy().contains("export"), "{error:?}");
    }
}

/// Text in UTF-16.
fn wide(text: &str, unit: fn(u16) -> [u8; 2]) -> Vec<u8> {
    std::iter::once(0xfeff).chain(text.encode_utf16()).flat_map(unit).collect()
}

/// The same text in the encodings and with the line ends that programs write.
fn spelled(text: &str) -> Vec<(&'static str, Vec<u8>)> {
    vec![
        ("as it is", text.into()),
        ("byte order mark", [b"\xef\xbb\xbf", text.as_bytes()].concat()),
        ("CRLF", text.replace('\n', "\r\n").into()),
        ("CR", text.replace('\n', "\r").into()),
        ("blank lines", format!("\n\n \t\n{}", text.replace('\n', " \n\n\t")).into()),
        ("tabs", text.replace(' ', "\t").into()),
        ("UTF-16 LE", wide(text, u16::to_le_bytes)),
        ("UTF-16 BE", wide(text, u16::to_be_bytes)),
    ]
}

const TEXT_STL: &str = "solid two parts\n\
    facet normal 0 0 1\n outer loop\n  vertex 0 0 0\n  vertex 1 0 0\n  vertex 0 1 0\n endloop\nendfacet\n\
    facet normal 0 0 1\n outer loop\n  vertex 5 0 0\n  vertex 6 0 0\n  vertex 5 1 0\n endloop\nendfacet\nendsolid two parts\n";

#[test]
fn text_stl_is_read_however_it_is_laid_out() {
    let without = |word: &str| TEXT_STL.replace(word, "").into_bytes();
    let two_solids = TEXT_STL.replacen("endfacet\nfacet", "endfacet\nendsolid two parts\nsolid b\nfacet", 1);
    let one_facet_a_line =
        TEXT_STL.replace("\n ", " ").replace(" \n", " ").replace("\nendfacet", " endfacet").replace("loop\n", "loop ");
    let mut files = spelled(TEXT_STL);
    files.extend(spelled(&TEXT_STL.to_uppercase()));
    files.extend(spelled(&two_solids));
    files.extend(vec![
        ("a facet a line", one_facet_a_line.into()),
        ("one line", TEXT_STL.replace('\n', " ").into()),
        ("two solids in one line", two_solids.replace('\n', " ").into()),
        ("a word a line", TEXT_STL.replace("two parts", "two").replace(' ', "\n").into()),
        ("no endloop", without("endloop")),
        ("the first without endloop", TEXT_STL.replacen("endloop", "", 1).into()),
        ("the last without endloop", TEXT_STL.replace("endloop\nendfacet\nendsolid", "endfacet\nendsolid").into()),
        ("no endfacet", without("endfacet")),
        ("neither", String::from_utf8(without("endloop")).unwrap().replace("endfacet", "").into()),
        ("no end at all", without("endsolid two parts\n")),
        ("no outer loop", without("outer loop")),
        ("no name", without(" two parts")),
        ("a name of the format's words", TEXT_STL.replace("two parts", "facet vertex outer loop").into()),
        ("words more", TEXT_STL.replace("0 1 0", "0 1 0 0.5 red").into()),
        ("a name in Latin-1", [b"solid pi\xe8ce\n", TEXT_STL.split_once('\n').unwrap().1.as_bytes()].concat()),
    ]);
    all_are_read("stl", &files);
}

#[test]
fn a_facet_of_text_stl_that_lacks_a_corner_refuses_the_file() {
    let altered = |from: &str, to: &str| TEXT_STL.replacen(from, to, 1).into_bytes();
    all_are_refused(
        "stl",
        &[
            ("facet of 2 corners that ends in line 6", altered("  vertex 1 0 0\n", "")),
            ("facet of 2 corners", altered("vertex 1 0 0", "vertx 1 0 0")),
            ("facet of 0 corners", altered("  vertex 0 0 0\n  vertex 1 0 0\n  vertex 0 1 0\n", "")),
            ("after `vertex` in line 5", altered("vertex 1 0 0", "vertex 1 0")),
            ("after `vertex` in line 5", altered("vertex 1 0 0", "vertex 1,0 0 0")),
            ("outside of a facet in line 2", TEXT_STL.replace("facet normal 0 0 1\n outer loop\n", "").into()),
            ("ends within a triangle", TEXT_STL.split_once("  vertex 5 1 0").unwrap().0.into()),
        ],
    );
}

/// A binary STL of both triangles, with this header and count and these additional bytes at its end.
fn binary_stl(header: &str, count: u32, after: &[u8]) -> Vec<u8> {
    let mut bytes = format!("{header:80}").into_bytes();
    bytes.extend(count.to_le_bytes());
    for x in [0.0_f32, 5.0] {
        bytes.extend([0; 12]);
        bytes.extend([x, 0.0, 0.0, x + 1.0, 0.0, 0.0, x, 1.0, 0.0].iter().flat_map(|c| c.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes.extend(after);
    bytes
}

#[test]
fn binary_stl_is_read_whole_or_refused() {
    let mut files = Vec::new();
    for header in ["binary", "solid made by a program", "SOLID", "solid facet normal vertex"] {
        for after in [&[][..], b"\r\n", &[7; 49], &[0; 120]] {
            files.push((header, binary_stl(header, 2, after)));
        }
    }
    all_are_read("stl", &files);
    for header in ["binary", "solid made by a program"] {
        all_are_refused(
            "stl",
            &[
                ("claims 1 triangles, and at byte 134", binary_stl(header, 1, &[])),
                ("claims 0 triangles, and at byte 84", binary_stl(header, 0, &[])),
                ("claims 3 triangles and has room for 2", binary_stl(header, 3, &[])),
                ("claims 3 triangles and has room for 2", binary_stl(header, 3, &[0; 49])),
                ("at byte 184", binary_stl(header, 2, &[7; 50])),
                ("at byte 184", binary_stl(header, 2, &binary_stl(header, 2, &[]))),
            ],
        );
    }
}

const OBJ: &str = "# two\nmtllib m.mtl\no a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\ng one\nusemtl m\nf 1//1 2//1 3//1\n\
    v 5 0 0\nv 6 0 0\nv 5 1 0\ng two\nf 4 5 6\n";

#[test]
fn obj_is_read_however_it_is_laid_out() {
    let altered = |from: &str, to: &str| {
        assert!(OBJ.contains(from), "{from}");
        OBJ.replace(from, to)
    };
    let wrapped = altered("f 4 5 6", "f 4 \\\n 5 \\\n6").replace("v 6 0 0", "v 6 \\\n0 0");
    let mut files = spelled(OBJ);
    files.extend(spelled(&OBJ.to_uppercase()));
    files.extend(spelled(&wrapped).into_iter().filter(|(what, _)| *what != "blank lines"));
    files.extend(vec![
        ("wrapped, with spaces after it", wrapped.replace('\\', "\\  ").into()),
        ("comments in lines", altered("f 4 5 6", "f 4 5 6 # the other").replace("v 6 0 0", "v 6 0 0# far").into()),
        ("a comment in a wrapped line", altered("f 4 5 6", "f 4 \\ # so\n 5 6").into()),
        (
            "a comment that ends in a backslash",
            altered("# two", "# from C:\\parts\\").replace("mtllib m.mtl\no a\n", "").into(),
        ),
        ("a folder that ends in a backslash", altered("mtllib m.mtl\no a", "mtllib C:\\parts\\").into()),
        ("a group that ends in a backslash", altered("g two", "g two\\").into()),
        ("colors", altered("v 6 0 0", "v 6 0 0 0.5 0.5 0.5").into()),
        ("weights", altered("v 6 0 0", "v 3 0 0 0.5").replace("v 0 0 0", "v 0 0 0 1").into()),
        ("counted backwards", altered("f 4 5 6", "f -3 -2 -1").replace("f 1//1 2//1 3//1", "f -3/1 -2/1 -1/1").into()),
        ("faces first", format!("f 4 5 6\n{}", altered("f 4 5 6", "")).into()),
        ("the old word", altered("f 4", "fo 4").into()),
        ("lines and curves", altered("g two", "l 1 2 3\np 1\ncstype bezier\ncurv 0 1 1 2 \\\n 3 4\nend").into()),
        ("a form feed", altered("\nf 4", "\u{c}f 4").into()),
        ("a name in Latin-1", OBJ.bytes().flat_map(|b| if b == b'#' { vec![b'#', 0xe8] } else { vec![b] }).collect()),
    ]);
    all_are_read("obj", &files);
}

#[test]
fn a_surface_of_obj_that_is_not_read_refuses_the_file() {
    let with = |line: &str| OBJ.replace("g two", line).into_bytes();
    all_are_refused(
        "obj",
        &[
            ("`surf` in line 14", with("surf 0 1 0 1 1 2 3 4")),
            ("`call` in line 14", with("call other.obj")),
            ("in line 14 with a corner that is none of its 6 vertices", with("f 1 2 7")),
            ("in line 14 with a corner", with("f 0 1 2")),
            ("in line 14 with a corner", with("f -7 1 2")),
            ("numbers of vertices in line 14", with("f 1, 2, 3")),
            ("numbers of vertices in line 14", with("f 1 / 1 2")),
            ("after `v` in line 14", with("v 0,1 0 0")),
            ("not finite", with("v 1 1 1 0")),
        ],
    );
}

/// A COLLADA file of both triangles: `surfaces` use the positions of `#v` (and of no other mesh's `#v`).
fn dae(asset: &str, surfaces: &str, nodes: &str) -> String {
    format!(
        "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<COLLADA>\n<asset>{asset}</asset>\n\
         <library_visual_scenes><visual_scene id=\"scene\">{nodes}</visual_scene></library_visual_scenes>\n\
         <library_geometries><geometry id=\"g\"><mesh>\n\
         <source id=\"s\"><float_array id=\"a\" count=\"18\">0 0 0 1 0 0 0 1 0 5 0 0 6 0 0 5 1 0</float_array>\
         <technique_common><accessor source=\"#a\" count=\"6\" stride=\"3\"/></technique_common></source>\n\
         <vertices id=\"v\"><input semantic=\"POSITION\" source=\"#s\"/></vertices>\n\
         {surfaces}\n\
         </mesh></geometry></library_geometries>\n\
         <scene><instance_visual_scene url=\"#scene\"/></scene></COLLADA>\n"
    )
}

const SHOWN: &str = "<node id=\"g\"><instance_geometry url=\"#g\"/></node>";
const INPUT: &str = "<input semantic=\"VERTEX\" source=\"#v\" offset=\"0\"/>";

/// A list of surfaces of this kind.
fn surface(kind: &str, count: &str, inner: &str) -> String {
    format!("<{kind} {count}>{INPUT}{inner}</{kind}>")
}

fn triangles(inner: &str) -> String {
    surface("triangles", "count=\"2\"", inner)
}

#[test]
fn collada_is_read_whatever_else_is_in_it() {
    let plain = dae("", &triangles("<p>0 1 2 3 4 5</p>"), SHOWN);
    let altered = |from: &str, to: &str| {
        assert!(plain.contains(from), "{from}");
        plain.replacen(from, to, 1)
    };
    let with = |surfaces: &str| dae("", surfaces, SHOWN).into_bytes();
    let camera = |look: &str| {
        dae("", &triangles("<p>0 1 2 3 4 5</p>"), &format!("<node id=\"cam\"><lookat>{look}</lookat></node>{SHOWN}"))
    };
    let author = |name: &[u8]| {
        let (before, after) = plain.split_once("<asset>").unwrap();
        [before.as_bytes(), b"<asset><!-- ", name, b" --><author>", name, b"</author>", after.as_bytes()].concat()
    };
    let mut files = spelled(&plain);
    files.retain(|(what, _)| *what != "blank lines"); // XML begins with its declaration
    files.extend(vec![
        ("a document type", altered("<COLLADA>", "<!DOCTYPE COLLADA><COLLADA>").into()),
        ("its address", altered("<COLLADA>", "<!DOCTYPE COLLADA SYSTEM \"http://e/c.dtd\"><COLLADA>").into()),
        ("its elements", altered("<COLLADA>", "<!DOCTYPE COLLADA [<!ELEMENT x ANY>]><COLLADA>").into()),
        ("bytes in Latin-1", author(b"Ren\xe9 \x96 \xff")),
        ("an &", author(b"A & B")),
        ("a hidden character", altered("id=\"s\"", "id=\"s\" name=\"a&#10;\u{200b}b\"").into()),
        ("a camera", camera("1 1 1 0 0 0 0 0 1").into()),
        ("a camera that looks nowhere", camera("0 0 0 0 0 0 0 1 0").into()),
        ("a comment in a list", with(&triangles("<p>0 1 2 <!-- the other --> 3 4 5</p>"))),
        ("a list as data", with(&triangles("<p><![CDATA[0 1 2 3 4 5]]></p>"))),
        ("characters by number", with(&triangles("<p>0&#32;1 2 3&#x20;4 5</p>"))),
        ("several lists", with(&triangles("<p>0 1 2</p><p>3 4 5</p>"))),
        ("no count", with(&surface("triangles", "", "<p>0 1 2 3 4 5</p>"))),
        ("a short count", with(&surface("triangles", "count=\"1\"", "<p>0 1 2 3 4 5</p>"))),
        ("an empty surface", with(&(triangles("<p>0 1 2 3 4 5</p>") + "<triangles count=\"0\"/><polylist count=\"0\"/>"))),
        ("lines", with(&(triangles("<p>0 1 2 3 4 5</p>") + &surface("lines", "count=\"1\"", "<p>0 1</p>")))),
        ("polygons", with(&surface("polygons", "count=\"2\"", "<p>0 1 2</p><p>3 4 5</p>"))),
        ("polygons of their own", with(&[surface("polygons", "", "<p>0 1 2</p>"), surface("polygons", "", "<p>3 4 5</p>")].concat())),
        ("a polylist", with(&surface("polylist", "count=\"2\"", "<vcount>3 3</vcount><p>0 1 2 3 4 5</p>"))),
        ("a polylist of lists", with(&surface("polylist", "count=\"2\"", "<vcount>3 3</vcount><p>0 1 2 3</p><p>4 5</p>"))),
        ("strips", with(&surface("tristrips", "count=\"2\"", "<p>0 1 2</p><p>3 4 5</p>"))),
        ("fans", with(&surface("trifans", "count=\"2\"", "<p>0 1 2</p><p>3 4 5</p>"))),
        ("a spline beside", altered("<geometry", "<geometry id=\"curve\"><spline/></geometry><geometry").into()),
        ("an id in two kinds", altered("id=\"g\"><mesh>", "id=\"g\" name=\"g\"><mesh>").into()),
        ("an id with a space", plain.replace("\"g\"", "\"my part\"").replace("#g", "#my%20part").into()),
        ("params in another order", altered("<accessor source=\"#a\" count=\"6\" stride=\"3\"/>",
            "<accessor source=\"#a\" count=\"6\" stride=\"3\"><param name=\"Y\"/><param name=\"X\"/><param name=\"Z\"/></accessor>")
            .replace("0 0 0 1 0 0 0 1 0 5 0 0 6 0 0 5 1 0", "0 0 0 0 1 0 1 0 0 0 5 0 0 6 0 1 5 0").into()),
        ("ids that another mesh has too", altered("<geometry", "<geometry id=\"h\"><mesh><source id=\"s\"><float_array>9 9 9</float_array></source>\
            <vertices id=\"v\"><input semantic=\"POSITION\" source=\"#s\"/></vertices></mesh></geometry><geometry").into()),
        ("no scene named", altered("<scene><instance_visual_scene url=\"#scene\"/></scene>", "").into()),
    ]);
    all_are_read("dae", &files);
}

#[test]
fn collada_that_lacks_a_part_is_refused_with_the_place() {
    let plain = dae("", &triangles("<p>0 1 2 3 4 5</p>"), SHOWN);
    let altered = |from: &str, to: &str| {
        assert!(plain.contains(from), "{from}");
        plain.replacen(from, to, 1).into_bytes()
    };
    let with = |surfaces: &str| dae("", surfaces, SHOWN).into_bytes();
    let two = "count=\"2\"";
    all_are_refused(
        "dae",
        &[
            ("<triangles> in line 8 should have 2 and has 1", with(&triangles("<p>0 1 2</p>"))),
            ("<triangles> in line 8 should have 2 and has 0", with(&triangles("<p/>"))),
            ("<triangles> in line 8 should have 2 and has 0", with(&triangles(""))),
            ("<triangles> in line 8 ends within a triangle", with(&triangles("<p>0 1 2 3 4</p>"))),
            ("unreadable count of <triangles> in line 8", with(&surface("triangles", "count=\"two\"", "<p>0 1 2</p>"))),
            (
                "<p> in line 8 ends within a corner",
                with(&triangles(
                    "<input semantic=\"NORMAL\" source=\"#s\" offset=\"1\"/>\
                <p>0 0 1 0 2 0 3 0 4 0 5</p>",
                )),
            ),
            ("<p> in line 8 of other things than text", with(&triangles("<p>0 1 2<b/>3 4 5</p>"))),
            ("`x` that is none of its 6", with(&triangles("<p>0 1 2 3 4 x</p>"))),
            ("line 6 should have 18 numbers and has 17", altered("5 1 0</float", "5 1</float")),
            ("line 6 should have 21 numbers and has 18", altered("count=\"6\"", "count=\"7\"")),
            ("too few corners", with(&surface("polylist", two, "<vcount>3 4</vcount><p>0 1 2 3 4 5</p>"))),
            (
                "more corners than its <vcount>",
                with(&surface("polylist", two, "<vcount>3 2</vcount><p>0 1 2 3 4 5</p>")),
            ),
            ("more corners than its <vcount>", with(&surface("polylist", two, "<p>0 1 2 3 4 5</p>"))),
            ("should have 2 and has 1", with(&surface("polylist", two, "<vcount>3</vcount><p>0 1 2</p>"))),
            (
                "<vcount> in line 8 of other things than numbers",
                with(&surface("polylist", two, "<vcount>3 -3</vcount><p>0 1 2</p>")),
            ),
            ("should have 2 and has 1", with(&surface("polygons", two, "<p>0 1 2</p>"))),
            ("should have 2 and has 1", with(&surface("tristrips", two, "<p>0 1 2</p>"))),
            ("should have 2 and has 1", with(&surface("trifans", two, "<p>0 1 2</p>"))),
            ("<skew> in line 4", altered("<instance_geometry", "<skew>45 1 0 0 0 1 0</skew><instance_geometry")),
            ("<rotate> in line 4", altered("<instance_geometry", "<rotate>0 0 1</rotate><instance_geometry")),
            ("not finite", altered("<instance_geometry", "<lookat>0 0 0 0 0 1 0 0 1</lookat><instance_geometry")),
            ("<convex_mesh>", altered("<mesh>", "<convex_mesh convex_hull_of=\"#h\"/><mesh>")),
            ("document type that declares entities", altered("<COLLADA>", "<!DOCTYPE x [<!ENTITY e \"1\">]><COLLADA>")),
            (
                "2 scenes",
                plain
                    .replacen("<visual_scene ", "<visual_scene id=\"t\"/><visual_scene ", 1)
                    .replace("=\"#scene\"", "=\"#none\"")
                    .into(),
            ),
            ("`#h` in <instance_geometry> in line 4", altered("url=\"#g\"", "url=\"#h\"")),
            (
                "<geometry> of the file has that id alone",
                altered("<geometry id=\"g\">", "<geometry id=\"g\"/><geometry id=\"g\">"),
            ),
        ],
    );
}

/// As in assimp: the node looks along its -z axis.
#[test]
fn a_collada_node_is_placed_by_where_it_looks() {
    let node = "<node><lookat>1 2 3  1 2 13  0 1 0</lookat><instance_geometry url=\"#g\"/></node>";
    let mesh = load("m.dae", dae("", &triangles("<p>0 1 2 3 4 5</p>"), node).as_bytes()).unwrap();
    assert_eq!(extent(&mesh), (2, [-5.0, 2.0, 3.0], [1.0, 3.0, 3.0]));
}

#[test]
fn a_collada_file_may_have_an_element_for_each_of_its_polygons() {
    let polygon = "<p>0 1 2</p>".repeat(60_000);
    let one = dae("", &surface("polygons", "count=\"60000\"", &polygon), SHOWN);
    assert_eq!(load("m.dae", one.as_bytes()).unwrap().triangles.len(), 60_000);
    let each = dae("", &surface("polygons", "count=\"1\"", "<p>0 1 2</p>").repeat(60_000), SHOWN);
    assert_eq!(load("m.dae", each.as_bytes()).unwrap().triangles.len(), 60_000);
    let many = dae("", &"<p/>".repeat(2_100_000), SHOWN);
    assert!(load("m.dae", many.as_bytes()).unwrap_err().message().contains("more than 2000000 elements"));
}

/// A glTF file of both triangles: its JSON contains the buffer's, and its buffer has these floats after the positions.
fn glb(json: &str) -> Vec<u8> {
    let positions = [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 5.0, 0.0, 0.0, 6.0, 0.0, 0.0, 5.0, 1.0, 0.0];
    let sparse = [5.0_f32, 0.0, 0.0, 6.0, 0.0, 0.0, 5.0, 1.0, 0.0];
    let mut binary: Vec<u8> = positions.iter().chain(&sparse).flat_map(|c| c.to_le_bytes()).collect();
    binary.extend([3, 4, 5, 9]);
    let whole = 12 + 8 + json.len() + 8 + binary.len();
    let mut out = [b"glTF".as_slice(), &2_u32.to_le_bytes(), &(whole as u32).to_le_bytes()].concat();
    for (kind, chunk) in [(b"JSON", json.as_bytes()), (b"BIN\0", &binary)] {
        out.extend((chunk.len() as u32).to_le_bytes().iter().chain(kind).chain(chunk));
    }
    out
}

const GLTF: &str = "{\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0}],\
    \"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}],\
    \"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":6,\"type\":\"VEC3\"}],\
    \"bufferViews\":[{\"buffer\":0,\"byteLength\":72},{\"buffer\":0,\"byteOffset\":72,\"byteLength\":36},\
    {\"buffer\":0,\"byteOffset\":108,\"byteLength\":4}],\"buffers\":[{\"byteLength\":112}]}";

#[test]
fn gltf_is_read_whole_or_refused() {
    let altered = |from: &str, to: &str| {
        assert!(GLTF.contains(from), "{from}");
        glb(&GLTF.replacen(from, to, 1))
    };
    let sparse = |indices: usize| {
        format!(
            "\"count\":6,\"sparse\":{{\"count\":3,\"indices\":{{\"bufferView\":2,\"byteOffset\":{indices},\"componentType\":5121}},\
             \"values\":{{\"bufferView\":1}}}},"
        )
    };
    let moved = "\"nodes\":[{\"children\":[1],\"translation\":[-5,0,0]},{\"mesh\":0,\"translation\":[5,0,0]}]";
    all_are_read(
        "glb",
        &[
            ("as it is", glb(GLTF)),
            ("no scene", altered("\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0}]", moved)),
            ("neither scene nor node", altered("\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0}],", "")),
            ("lines beside", altered("[{\"attributes\"", "[{\"mode\":1,\"attributes\":{}},{\"attributes\"")),
            ("bytes after its end", [glb(GLTF), vec![0; 3]].concat()),
            ("sparse", altered("\"count\":6,", &sparse(0))),
        ],
    );
    let alone = "\"componentType\":5126,".to_owned() + &sparse(0);
    let alone = altered("\"bufferView\":0,\"componentType\":5126,\"count\":6,", &alone);
    assert_eq!(load("m.glb", &alone).unwrap().triangles.len(), 1, "what is not given is zero");
    let whole = glb(GLTF);
    all_are_refused(
        "glb",
        &[
            ("is cut off: it claims", whole[..whole.len() - 120].to_vec()),
            ("ends within a triangle", altered("\"count\":6", "\"count\":5")),
            ("unknown mode 7", altered("{\"attributes\"", "{\"mode\":7,\"attributes\"")),
            ("without positions", altered("\"POSITION\":0", "\"NORMAL\":0")),
            ("a scene that is not there", altered("{\"scenes\"", "{\"scene\":3,\"scenes\"")),
            ("in another file", altered("{\"byteLength\":112", "{\"uri\":\"m.bin\",\"byteLength\":112")),
            ("gpu_instancing", altered("{\"mesh\":0}", "{\"mesh\":0,\"extensions\":{\"EXT_mesh_gpu_instancing\":{}}}")),
            ("changes what it does not have", altered("\"count\":6,", &sparse(1))),
        ],
    );
}

fn link(file: &str) -> String {
    format!(
        "<robot name=\"r\"><link name=\"a\"><collision><geometry><mesh filename=\"{file}\"/></geometry></collision></link></robot>"
    )
}

/// The warnings of a URDF in its own folder, with meshes beside it.
fn import(file: &str, meshes: &[&str]) -> Result<Vec<String>, FileError> {
    let dir = tempfile::tempdir().unwrap();
    let urdf = dir.path().join("arm/urdf/r.urdf");
    for path in meshes.iter().map(|m| dir.path().join(m)).chain([urdf.clone()]) {
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, TEXT_STL).unwrap();
    }
    std::fs::write(&urdf, link(file)).unwrap();
    let loaded = load_surfaces(&urdf, &UrdfOptions::default())?;
    assert_eq!(loaded.value.len(), 1);
    Ok(loaded.warnings.iter().map(|w| format!("{w}; {}", w.remedy())).collect())
}

#[test]
fn a_mesh_is_found_by_the_names_that_programs_write() {
    for (file, mesh) in [
        ("package://arm/meshes/my%20part.stl", "arm/meshes/my part.stl"),
        ("package://arm/meshes/my%20part.stl", "arm/meshes/my%20part.stl"),
        ("model://arm/meshes/b%c3%a9.stl", "arm/meshes/bé.stl"),
        ("meshes/my%20part.stl", "arm/urdf/meshes/my part.stl"),
        ("../meshes/P.STL", "arm/meshes/P.STL"),
    ] {
        assert_eq!(import(file, &[mesh]).unwrap(), [""; 0], "{file}");
    }
    for (file, mesh) in [
        ("..\\meshes\\p.stl", "arm/meshes/p.stl"),
        ("package://arm\\meshes\\p.stl", "arm/meshes/p.stl"),
        ("package:\\\\arm\\meshes\\my%20part.stl", "arm/meshes/my part.stl"),
    ] {
        let warnings = import(file, &[mesh]).unwrap();
        assert!(
            warnings.len() == 1 && warnings[0].contains("backslash") && warnings[0].contains("write /"),
            "{warnings:?}"
        );
    }
    assert_eq!(import("a\\p.stl", &["arm/urdf/a\\p.stl"]).unwrap(), [""; 0], "a backslash may be part of a name");
}

#[test]
fn each_trouble_with_a_mesh_has_a_remedy_of_its_own() {
    for (file, mesh, message, help) in [
        ("p.stl", "arm/q.stl", "not found", "--meshes DIR"),
        ("package://arm/p.stl", "arm/q.stl", "not found", "--package arm=DIR"),
        ("parts\\p.stl", "arm/q.stl", "not found", "write / between folders, not \\"),
        ("~/p.stl", "arm/q.stl", "not found", "`~` and variables are not expanded"),
        ("$HOME/p.stl", "arm/q.stl", "not found", "`~` and variables are not expanded"),
        ("p.ply", "arm/urdf/p.ply", "type `ply`", "export it as one of these"),
        ("p.obj", "arm/urdf/p.obj", "no surface", "export it again"),
    ] {
        let error = import(file, &[mesh]).unwrap_err();
        assert!(error.message().contains(message) && error.remedy().contains(help), "{error:?}");
        let searched = help.contains("DIR") || message == "not found";
        assert_eq!(
            error.remedy().contains("--meshes DIR") || error.remedy().contains("--package"),
            searched,
            "{error:?}"
        );
        assert!(error.remedy().contains("--drop-meshes"), "{error:?}");
    }
}

#[test]
fn what_a_mesh_has_beside_its_surface_is_noted_once() {
    let dir = tempfile::tempdir().unwrap();
    let notes = |name: &str, bytes: &[u8]| -> Vec<String> {
        std::fs::write(dir.path().join(name), bytes).unwrap();
        let collision = "<collision><geometry><mesh filename=\"F\"/></geometry></collision>".replace('F', name);
        let twice = format!("<robot name=\"r\"><link name=\"a\">{collision}{collision}</link></robot>");
        std::fs::write(dir.path().join("r.urdf"), twice).unwrap();
        let loaded = load_surfaces(dir.path().join("r.urdf"), &UrdfOptions::default()).unwrap();
        loaded.warnings.iter().map(|w| w.message().to_owned()).collect()
    };
    let endless = TEXT_STL.replace("endsolid two parts\n", "");
    assert_eq!(
        notes("a.stl", endless.as_bytes()),
        ["link `a`: the mesh a.stl ends without `endsolid`: it may be cut off"]
    );
    let more = binary_stl("", 2, &[1; 3]);
    assert_eq!(notes("b.stl", &more), ["link `a`: the mesh b.stl has 3 bytes after its end, which are not used"]);
    let odd = OBJ.replace("g two", "ff 1 2 3");
    assert_eq!(
        notes("c.obj", odd.as_bytes()),
        ["link `a`: the mesh c.obj has a word that is not used, `ff` in line 14"]
    );
}

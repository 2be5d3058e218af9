//! Malformed and hostile URDF and mesh files: each causes a clear error or warning, at once and with little memory.

use mobee_import::{UpAxis, UrdfOptions, load_mesh, load_surfaces, load_urdf, parse_urdf};

use mobee_model::{FileError, Mesh};
use std::path::Path;

fn mesh(dir: &Path, name: &str, bytes: &[u8]) -> Result<Mesh, FileError> {
    let path = dir.join(name);
    std::fs::write(&path, bytes).unwrap();
    load_mesh(path)
}

/// A binary STL that declares this number of triangles, and has these corners.
fn stl(claimed: u32, triangles: &[[[f32; 3]; 3]]) -> Vec<u8> {
    let mut bytes = vec![b' '; 80];
    bytes.extend(claimed.to_le_bytes());
    for triangle in triangles {
        bytes.extend([0; 12]);
        bytes.extend(triangle.iter().flatten().flat_map(|c| c.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

const CORNERS: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

/// A COLLADA file with a triangle of this list of corners, in this scene.
fn dae(asset: &str, corners: &str, nodes: &str) -> String {
    format!(
        "<COLLADA><asset>{asset}</asset><library_geometries><geometry id=\"g\"><mesh>\
         <source id=\"s\"><float_array id=\"a\" count=\"9\">0 0 0 1 0 0 0 2 0</float_array>\
         <technique_common><accessor source=\"#a\" count=\"3\" stride=\"3\"/></technique_common></source>\
         <vertices id=\"v\"><input semantic=\"POSITION\" source=\"#s\"/></vertices>\
         <triangles count=\"1\"><input semantic=\"VERTEX\" source=\"#v\" offset=\"0\"/><p>{corners}</p></triangles>\
         </mesh></geometry></library_geometries>\
         <library_visual_scenes><visual_scene id=\"scene\">{nodes}</visual_scene></library_visual_scenes>\
         <scene><instance_visual_scene url=\"#scene\"/></scene></COLLADA>"
    )
}

const SHOWN: &str = "<node><instance_geometry url=\"#g\"/></node>";

#[test]
fn a_nasty_mesh_is_refused_with_the_reason() {
    let dir = tempfile::tempdir().unwrap();
    let shown_twice = |name: &str, shows: &str| {
        format!("<node id=\"{name}\"><instance_node url=\"#{shows}\"/><instance_node url=\"#{shows}\"/></node>")
    };
    let explosion: String = (0..40).map(|i| shown_twice(&format!("n{i}"), &format!("n{}", i + 1))).collect();
    let explosion = explosion + "<node id=\"n40\"/>";
    let cases: Vec<(&str, Vec<u8>, &str)> = vec![
        ("empty.stl", vec![], "is empty"),
        ("short.stl", vec![0; 83], "cut off"),
        ("header.stl", stl(0, &[]), "no surface"),
        ("billions.stl", stl(u32::MAX, &[CORNERS]), "claims 4294967295 triangles and has room for 1"),
        ("nan.stl", stl(1, &[[[f32::NAN, 0.0, 0.0], CORNERS[1], CORNERS[2]]]), "not finite"),
        ("infinite.stl", stl(1, &[[[f32::INFINITY, 0.0, 0.0], CORNERS[1], CORNERS[2]]]), "not finite"),
        ("far.stl", stl(1, &[[[1e30, 0.0, 0.0], CORNERS[1], CORNERS[2]]]), "beyond"),
        ("point.stl", stl(1, &[[[0.5; 3]; 3]]), "no surface"),
        ("text.stl", b"solid x\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n".to_vec(), "ends within a triangle"),
        ("word.stl", b"solid x\nouter loop\nvertex 0 zero 0\n".to_vec(), "line 3"),
        ("nothing.stl", b"solid x\nendsolid x\n".to_vec(), "no surface"),
        ("points.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n".to_vec(), "no surface"),
        ("beyond.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n".to_vec(), "line 4"),
        ("zero.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n".to_vec(), "none of its 3 vertices"),
        ("before.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf -1 -2 -9223372036854775808\n".to_vec(), "line 4"),
        ("word.obj", b"v 0 0 0\nf a b c\n".to_vec(), "line 2"),
        ("flat.obj", b"v 0 0\n".to_vec(), "line 1"),
        ("empty.dae", vec![], "no element"),
        ("cut.dae", dae("", "0 1 2", SHOWN).into_bytes()[..300].to_vec(), "tag not closed"),
        ("binary.dae", vec![0xff; 100], "not UTF-8"),
        (
            "entity.dae",
            b"<!DOCTYPE x [<!ENTITY e SYSTEM \"file:///etc/passwd\">]><COLLADA>&e;</COLLADA>".to_vec(),
            "document type",
        ),
        ("deep.dae", "<node>".repeat(100_000).into_bytes(), "nested"),
        ("other.dae", b"<robot/>".to_vec(), "<robot>"),
        ("index.dae", dae("", "0 1 3", SHOWN).into_bytes(), "none of its 3 vertices"),
        ("word.dae", dae("", "0 1 x", SHOWN).into_bytes(), "`x`"),
        ("unit.dae", dae("<unit meter=\"0\"/>", "0 1 2", SHOWN).into_bytes(), "unit"),
        ("hidden.dae", dae("", "0 1 2", "<node/>").into_bytes(), "no surface"),
        ("nowhere.dae", dae("", "0 1 2", "<node><instance_geometry url=\"#h\"/></node>").into_bytes(), "`#h`"),
        ("matrix.dae", dae("", "0 1 2", "<node><matrix>1 0 0</matrix></node>").into_bytes(), "<matrix>"),
        ("circle.dae", dae("", "0 1 2", "<node id=\"n\"><instance_node url=\"#n\"/></node>").into_bytes(), "nested"),
        ("explosion.dae", dae("", "0 1 2", &explosion).into_bytes(), "instances"),
        ("robot.mesh", vec![1, 2, 3], "type `mesh`"),
        ("none", vec![1, 2, 3], "STL, OBJ, COLLADA"),
    ];
    for (name, bytes, expected) in cases {
        let error = mesh(dir.path(), name, &bytes).expect_err(name);
        assert!(error.message().contains(expected) && !error.remedy().is_empty(), "{name}: {error:?}");
    }
}

#[test]
fn a_million_triangles_are_read_and_one_more_is_not() {
    let dir = tempfile::tempdir().unwrap();
    let place = |i: u32| CORNERS.map(|c| [c[0] + (i % 1000) as f32, c[1] + (i / 1000) as f32, c[2]]);
    let mut triangles: Vec<_> = (0..1_000_000).map(place).collect();
    let read = mesh(dir.path(), "large.stl", &stl(1_000_000, &triangles)).unwrap();
    assert_eq!((read.triangles.len(), read.vertices.len()), (1_000_000, 1001 * 1001 - 1));
    triangles.push(CORNERS);
    let refused = mesh(dir.path(), "larger.stl", &stl(1_000_001, &triangles)).unwrap_err();
    assert!(refused.message().contains("more than 1000000 triangles"), "{refused}");
}

/// The corners of a COLLADA file's only triangle.
fn corners(dir: &Path, text: &str) -> Vec<[f64; 3]> {
    let mesh = mesh(dir, "mesh.dae", text.as_bytes()).unwrap();
    let round = |c: f64| (c * 1e6).round() / 1e6 + 0.0;
    mesh.triangles[0].map(|i| mesh.vertices[i as usize].map(round).into()).to_vec()
}

/// As in RViz, MoveIt and coal.
#[test]
fn a_collada_file_has_its_unit_and_its_nodes_and_is_not_turned_for_its_up_axis() {
    let dir = tempfile::tempdir().unwrap();
    let drawn = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0]];
    for up in ["X_UP", "Y_UP", "Z_UP"] {
        assert_eq!(corners(dir.path(), &dae(&format!("<up_axis>{up}</up_axis>"), "0 1 2", SHOWN)), drawn);
    }
    let millimeters = dae("<unit name=\"millimeter\" meter=\"0.001\"/>", "0 1 2", SHOWN);
    assert_eq!(corners(dir.path(), &millimeters), [[0.0, 0.0, 0.0], [0.001, 0.0, 0.0], [0.0, 0.002, 0.0]]);
    let nodes = "<node><translate>0 0 5</translate><node><rotate>0 0 1 90</rotate><scale>1 1 1</scale>\
                 <instance_geometry url=\"#g\"/></node></node>";
    assert_eq!(corners(dir.path(), &dae("", "0 1 2", nodes)), [[0.0, 0.0, 5.0], [0.0, 1.0, 5.0], [-2.0, 0.0, 5.0]]);
    let matrix = "<node><matrix>1 0 0 7  0 1 0 8  0 0 1 9  0 0 0 1</matrix><instance_geometry url=\"#g\"/></node>";
    assert_eq!(corners(dir.path(), &dae("", "0 1 2", matrix)), [[7.0, 8.0, 9.0], [8.0, 8.0, 9.0], [7.0, 10.0, 9.0]]);
    let twice = mesh(dir.path(), "twice.dae", dae("", "0 1 2", &(SHOWN.to_owned() + nodes)).as_bytes()).unwrap();
    assert_eq!(twice.triangles.len(), 2, "each instance is there");
}

/// A file does not name the tools it was made for, but the centers of mass of its links indicate the orientation.
#[test]
fn a_collada_mesh_is_turned_upright_if_the_masses_say_so_or_if_asked() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("m.dae"), dae("<up_axis>Y_UP</up_axis>", "0 1 2", SHOWN)).unwrap();
    // The center of the triangle is at y = 1 as drawn, and at z = 1 if it is rotated.
    let robot = |center: &str, links: usize| -> String {
        let link = |i: usize| {
            format!(
                "<link name=\"l{i}\"><inertial><mass value=\"1\"/><origin xyz=\"{center}\"/></inertial>\
                 <collision><geometry><mesh filename=\"m.dae\"/></geometry></collision></link>"
            )
        };
        let joint = |i: usize| {
            format!("<joint name=\"j{i}\" type=\"fixed\"><parent link=\"l0\"/><child link=\"l{i}\"/></joint>")
        };
        let all: String = (0..links).map(link).chain((1..links).map(joint)).collect();
        format!("<robot name=\"r\">{all}</robot>")
    };
    let highest = |text: &str, up_axis: UpAxis| {
        let path = dir.path().join("r.urdf");
        std::fs::write(&path, text).unwrap();
        let loaded = load_surfaces(&path, &UrdfOptions { up_axis, ..UrdfOptions::default() }).unwrap();
        let said = loaded.warnings.iter().any(|w| w.message().contains("turned"));
        let high = loaded.value[0].meshes[0].vertices.iter().map(|v| v.z).fold(0.0, f64::max);
        (high, said)
    };
    let (drawn, upright) = (robot("0.5 1 0", 3), robot("0.5 0 1", 3));
    assert_eq!(highest(&drawn, UpAxis::Guess), (0.0, false));
    assert_eq!(highest(&upright, UpAxis::Guess), (2.0, true));
    assert_eq!(highest(&upright, UpAxis::Ignore), (0.0, false));
    assert_eq!(highest(&drawn, UpAxis::Respect), (2.0, false));
    assert_eq!(highest(&robot("0.5 0 1", 2), UpAxis::Guess), (0.0, false), "two links tell nothing");
    assert_eq!(highest(&robot("0.5 0.6 0.6", 3), UpAxis::Guess), (0.0, false), "as near either way");
    assert_eq!(highest(&robot("nobody knows", 3), UpAxis::Guess), (0.0, false));
}

#[test]
fn what_is_neither_kinematics_nor_shape_cannot_stop_a_conversion() {
    let text = "<robot name=\"r\" xmlns:xacro=\"http://ros.org/wiki/xacro\"><material><texture/></material>\
                <transmission/><gazebo><plugin filename=\"$(find x)\"/></gazebo><ros2_control type=\"x\"><joint/></ros2_control>\
                <!-- ${not} a formula --><vendor:tag n=\"1\">text</vendor:tag><sensor/>\
                <link name=\"a\"><inertial/><visual><geometry><mesh/></geometry><material/></visual></link></robot>";
    let loaded = parse_urdf("r.urdf", text, &UrdfOptions::default()).unwrap();
    let warnings: Vec<&str> = loaded.warnings.iter().map(FileError::message).collect();
    assert_eq!(
        warnings,
        ["no link has a <collision>: nothing of this robot will ever touch anything; they have a <visual>: `a`"]
    );
}

#[test]
fn what_is_no_urdf_is_told_as_what_it_is() {
    let joint = |inner: &str| {
        format!(
            "<robot name=\"r\"><link name=\"a\"/><link name=\"b\"/><joint name=\"j\" type=\"revolute\">\
             <parent link=\"a\"/><child link=\"b\"/>{inner}</joint></robot>"
        )
    };
    let shape = |inner: &str| {
        format!("<robot name=\"r\"><link name=\"a\"><collision><geometry>{inner}</geometry></collision></link></robot>")
    };
    let long = "x".repeat(100_000);
    let cases = [
        ("<sdf version=\"1.7\"><model/></sdf>".to_owned(), "<sdf>", "SDF"),
        ("<mujoco><worldbody/></mujoco>".to_owned(), "<mujoco>", "MJCF"),
        ("<COLLADA/>".to_owned(), "<COLLADA>", "mesh"),
        ("<robot name=\"r\"/>".to_owned(), "no link", "<link>"),
        ("<robot xmlns:xacro=\"x\"/>".to_owned(), "only defines macros", "xacro FILE > robot.urdf"),
        ("<robot><xacro:include filename=\"a\"/></robot>".to_owned(), "xacro file", "ros2 run xacro xacro"),
        ("<robot><link name=\"${p}a\"/></robot>".to_owned(), "`${p}a`", "xacro FILE > robot.urdf"),
        ("<robot><link name=\"a\"><xacro:if/></link></robot>".to_owned(), "<xacro:if>", "xacro FILE"),
        ("<robot><link name=\"\"/></robot>".to_owned(), "without `name`", "name="),
        ("<robot><link name=\"a\" name=\"b\"/></robot>".to_owned(), "well-formed", "attributes"),
        (joint(""), "moves, and has no limits", "<limit"),
        (joint("<limit lower=\"-1,5\"/>"), "`-1,5`", "number"),
        (joint("<axis xyz=\"0 1\"/>"), "three finite numbers", "three numbers"),
        (joint("<origin xyz=\"1e300 0 0\"/>"), "beyond", "meters"),
        (shape(""), "without a geometry", "<geometry>"),
        (shape("<plane/>"), "<plane>", "box"),
        (shape("<sphere/>"), "without `radius`", "radius"),
        (shape("<box size=\"1 1\"/>"), "three finite numbers", "three numbers"),
        (shape("<cylinder radius=\"nan\" length=\"1\"/>"), "above zero", "above zero"),
        (shape("<mesh filename=\"../../../../etc/passwd\"/>"), "mesh ../../../../etc/passwd", "export it"),
        (shape("<mesh filename=\"file:///etc/passwd\"/>"), "STL, OBJ, COLLADA", "export it"),
        (shape(&format!("<mesh filename=\"{long}\"/>")), "link `a`", "--meshes"),
    ];
    for (text, message, help) in cases {
        let options = UrdfOptions { mesh_folders: vec!["/".into()], ..Default::default() };
        let error = parse_urdf("r.urdf", &text, &options).expect_err(&text);
        assert!(error.message().contains(message) && error.remedy().contains(help), "{error:?}");
        assert!(error.line() == 1 && error.to_string().len() < 5000, "{error:?}");
    }
}

#[test]
fn a_mesh_is_found_in_its_package_and_its_unit_is_doubted() {
    let dir = tempfile::tempdir().unwrap();
    let put = |name: &str, bytes: &[u8]| {
        let path = dir.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    };
    let large = CORNERS.map(|c| c.map(|x| x * 80.0));
    put("share/arm/meshes/link.stl", &stl(1, &[large]));
    put("given/meshes/link.stl", &stl(1, &[CORNERS]));
    let urdf = |file: &str, scale: &str| {
        format!(
            "<robot name=\"r\"><link name=\"a\"><collision><geometry><mesh filename=\"{file}\" {scale}/></geometry>\
             </collision></link></robot>"
        )
    };
    for (file, scale) in
        [("package://arm/meshes/link.stl", ""), ("package:///arm/meshes/link.stl", ""), ("../meshes/link.stl", "")]
    {
        put("share/arm/urdf/robot.urdf", urdf(file, scale).as_bytes());
        let loaded = load_urdf(dir.path().join("share/arm/urdf/robot.urdf"), &UrdfOptions::default()).unwrap();
        let warning = &loaded.warnings[0];
        assert!(
            warning.message().contains("80 m long") && warning.remedy().contains("0.001 0.001 0.001"),
            "{warning:?}"
        );
    }
    put("share/arm/urdf/robot.urdf", urdf("../meshes/link.stl", "scale=\"0.001 0.001 0.001\"").as_bytes());
    let loaded = load_urdf(dir.path().join("share/arm/urdf/robot.urdf"), &UrdfOptions::default()).unwrap();
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    let options = UrdfOptions { packages: [("arm".into(), dir.path().join("given"))].into(), ..Default::default() };
    put("share/arm/urdf/robot.urdf", urdf("package://arm/meshes/link.stl", "").as_bytes());
    let loaded = load_urdf(dir.path().join("share/arm/urdf/robot.urdf"), &options).unwrap();
    let doubts = loaded.warnings.iter().filter(|w| w.message().contains("m long")).count();
    assert_eq!(doubts, 0, "the folder that was given comes first: {:?}", loaded.warnings);
}

/// A glTF file with an embedded buffer.
fn glb(json: &str, binary: &[u8]) -> Vec<u8> {
    let mut out = [b"glTF".as_slice(), &2_u32.to_le_bytes(), &0_u32.to_le_bytes()].concat();
    for (kind, chunk) in [(b"JSON", json.as_bytes()), (b"BIN\0", binary)] {
        out.extend((chunk.len() as u32).to_le_bytes().iter().chain(kind).chain(chunk));
    }
    out
}

/// The JSON of a glTF file: a triangle strip of four corners in the buffer, after their indices, used by these nodes.
fn gltf(nodes: &str, more: &str) -> String {
    format!(
        "{{\"asset\":{{\"version\":\"2.0\"}},\"scene\":0,\"scenes\":[{{\"nodes\":[0]}}],\"nodes\":[{nodes}],{more}\
         \"meshes\":[{{\"primitives\":[{{\"mode\":1,\"attributes\":{{}}}},{{\"mode\":5,\"indices\":1,\"attributes\":{{\"POSITION\":0}}}}]}}],\
         \"accessors\":[{{\"bufferView\":1,\"componentType\":5126,\"count\":4,\"type\":\"VEC3\"}},\
         {{\"bufferView\":0,\"componentType\":5123,\"count\":4,\"type\":\"SCALAR\"}}],\
         \"bufferViews\":[{{\"buffer\":0,\"byteLength\":8}},{{\"buffer\":0,\"byteOffset\":8,\"byteLength\":64,\"byteStride\":16}}],\
         \"buffers\":[{{\"byteLength\":72}}]}}"
    )
}

/// Four corners of a square, 16 bytes each, after their indices.
fn square(indices: [u16; 4]) -> Vec<u8> {
    let corners = [[0.0_f32, 0.0, 0.0, 9.0], [1.0, 0.0, 0.0, 9.0], [0.0, 2.0, 0.0, 9.0], [1.0, 2.0, 0.0, 9.0]];
    let indices = indices.iter().flat_map(|i| i.to_le_bytes());
    indices.chain(corners.iter().flatten().flat_map(|c| c.to_le_bytes())).collect()
}

#[test]
fn a_gltf_file_shows_its_triangles_where_its_nodes_put_them() {
    let dir = tempfile::tempdir().unwrap();
    let shown = "{\"children\":[1],\"translation\":[0,0,5]},\
                 {\"mesh\":0,\"rotation\":[0,0,0.7071067811865476,0.7071067811865476],\"scale\":[2,1,1]}";
    let mesh = mesh(dir.path(), "m.glb", &glb(&gltf(shown, ""), &square([0, 1, 2, 3]))).unwrap();
    let mut places: Vec<[i64; 3]> = mesh.vertices.iter().map(|v| v.map(|c| c.round() as i64).into()).collect();
    places.sort();
    assert_eq!(places, [[-2, 0, 5], [-2, 2, 5], [0, 0, 5], [0, 2, 5]]);
    assert_eq!(mesh.triangles.len(), 2);
}

#[test]
fn a_nasty_gltf_file_is_refused_with_the_reason() {
    let dir = tempfile::tempdir().unwrap();
    let (one, good) = ("{\"mesh\":0}", square([0, 1, 2, 3]));
    let whole = glb(&gltf(one, ""), &good);
    let altered = |from: &str, to: &str| {
        let text = gltf(one, "");
        assert!(text.contains(from), "{from}");
        glb(&text.replacen(from, to, 1), &good)
    };
    let cases = [
        (Vec::new(), "no binary glTF"),
        (b"glTF\x01\0\0\0".to_vec(), "no binary glTF"),
        (b"glTF\x02\0\0\0\0\0\0\0".to_vec(), "no JSON"),
        (whole[..whole.len() - 1].to_vec(), "cut off"),
        (glb("{\"nodes\":[{\"mesh\":-1}]}", &good), "no glTF"),
        (glb(&"[".repeat(100_000), &good), "no glTF"),
        (glb(&gltf(one, ""), &square([0, 1, 2, 4])), "none of its 4 vertices"),
        (glb(&gltf(one, ""), &[]), "another file"),
        (glb(&gltf("{\"children\":[0]}", ""), &good), "nested"),
        (glb(&gltf("{\"children\":[1,1]},{\"children\":[0,0]}", ""), &good), "nested"),
        (glb(&gltf("{\"children\":[7]}", ""), &good), "node 7"),
        (glb(&gltf("{\"mesh\":7}", ""), &good), "mesh 7"),
        (glb(&gltf("{\"mesh\":0,\"skin\":0}", ""), &good), "skin"),
        (glb(&gltf("{}", ""), &good), "no surface"),
        (glb(&gltf(one, "\"extensionsRequired\":[\"KHR_draco_mesh_compression\"],"), &good), "draco"),
        (altered("\"count\":4", "\"count\":5"), "beyond its view"),
        (altered("\"count\":4", "\"count\":18446744073709551615"), "beyond its view"),
        (altered("\"byteLength\":64", "\"byteLength\":65"), "beyond its view"),
        (altered("5126", "5120"), "unknown numbers"),
        (altered("5126", "5121"), "quantization"),
        (altered("\"VEC3\"", "\"VEC4\""), "no plain list"),
        (altered("\"bufferView\":1,", "\"bufferView\":9,"), "without a view"),
    ];
    for (i, (bytes, expected)) in cases.into_iter().enumerate() {
        let error = mesh(dir.path(), "m.glb", &bytes).expect_err(expected);
        assert!(error.message().contains(expected) && !error.remedy().is_empty(), "{i}: {error:?}");
    }
    let nan = good.len() - 64;
    let broken = [&good[..nan], &f32::NAN.to_le_bytes(), &good[nan + 4..]].concat();
    assert!(mesh(dir.path(), "m.glb", &glb(&gltf(one, ""), &broken)).unwrap_err().message().contains("not finite"));
}

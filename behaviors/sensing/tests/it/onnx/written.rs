//! Networks in ONNX format, written byte by byte as protocol buffers.

/// A network: its operations, weights, inputs and outputs.
#[derive(Clone)]
pub struct Graph {
    pub nodes: Vec<Vec<u8>>,
    pub constants: Vec<Tensor>,
    pub inputs: Vec<Vec<u8>>,
    pub outputs: Vec<String>,
}

/// Encodes a tensor of weights as a message.
#[derive(Clone)]
pub struct Tensor(Vec<u8>);

fn varint(mut n: u64) -> Vec<u8> {
    let mut out = Vec::new();
    while n >= 0x80 {
        out.push(n as u8 | 0x80);
        n >>= 7;
    }
    out.push(n as u8);
    out
}

/// Encodes a numeric field.
fn number(field: u64, n: u64) -> Vec<u8> {
    [varint(field << 3), varint(n)].concat()
}

/// Encodes a field of text, bytes or a message.
fn bytes(field: u64, of: impl AsRef<[u8]>) -> Vec<u8> {
    let of = of.as_ref();
    [&varint(field << 3 | 2), &varint(of.len() as u64), of].concat()
}

/// Encodes an operation; its attributes are lists of integers, or one number.
pub fn node(kind: &str, inputs: &[&str], outputs: &[&str], attributes: &[(&str, &[u64])]) -> Vec<u8> {
    let mut out = Vec::new();
    inputs.iter().for_each(|name| out.extend(bytes(1, name)));
    outputs.iter().for_each(|name| out.extend(bytes(2, name)));
    out.extend(bytes(3, format!("{kind}_{}", outputs[0])));
    out.extend(bytes(4, kind));
    for (name, values) in attributes {
        let mut attribute = bytes(1, name);
        match values {
            [one] => attribute.extend([number(3, *one), number(20, 2)].concat()),
            many => {
                many.iter().for_each(|n| attribute.extend(number(8, *n)));
                attribute.extend(number(20, 7));
            }
        }
        out.extend(bytes(5, attribute));
    }
    out
}

/// Encodes an operation with a graph as its body, such as `Loop`.
#[allow(dead_code, reason = "not every test has such operations")]
pub fn node_with_body(kind: &str, inputs: &[&str], outputs: &[&str], body: &Graph) -> Vec<u8> {
    let attribute = [bytes(1, "body"), bytes(6, body.graph()), number(20, 5)].concat();
    [node(kind, inputs, outputs, &[]), bytes(5, attribute)].concat()
}

/// Encodes a 64-bit integer.
#[allow(dead_code, reason = "not every test has such numbers")]
pub fn whole(name: &str, shape: &[u64], values: &[i64]) -> Tensor {
    let raw: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    let sizes: Vec<u8> = shape.iter().flat_map(|n| number(1, *n)).collect();
    Tensor([sizes, number(2, 7), bytes(8, name), bytes(9, raw)].concat())
}

/// Encodes weights of single precision.
pub fn constant(name: &str, shape: &[u64], values: &[f32]) -> Tensor {
    let raw: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    let sizes: Vec<u8> = shape.iter().flat_map(|n| number(1, *n)).collect();
    Tensor([sizes, number(2, 1), bytes(8, name), bytes(9, raw)].concat())
}

/// Encodes an input; `None`: a dimension that is left open.
pub fn input(name: &str, shape: &[Option<u64>]) -> Vec<u8> {
    let dimension = |n: &Option<u64>| bytes(1, n.map_or_else(|| bytes(2, "open"), |n| number(1, n)));
    let sizes: Vec<u8> = shape.iter().flat_map(dimension).collect();
    [bytes(1, name), bytes(2, bytes(1, [number(1, 1), bytes(2, sizes)].concat()))].concat()
}

impl Graph {
    /// Encodes the graph as a message.
    fn graph(&self) -> Vec<u8> {
        let mut graph = Vec::new();
        self.nodes.iter().for_each(|n| graph.extend(bytes(1, n)));
        graph.extend(bytes(2, "graph"));
        self.constants.iter().for_each(|t| graph.extend(bytes(5, &t.0)));
        self.inputs.iter().for_each(|i| graph.extend(bytes(11, i)));
        let output = |name: &String| bytes(12, [bytes(1, name), bytes(2, bytes(1, number(1, 1)))].concat());
        self.outputs.iter().for_each(|o| graph.extend(output(o)));
        graph
    }

    /// Encodes the whole file.
    pub fn bytes(&self) -> Vec<u8> {
        let opset = [bytes(1, ""), number(2, 13)].concat();
        [number(1, 8), bytes(7, self.graph()), bytes(8, opset)].concat()
    }
}

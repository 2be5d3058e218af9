//! Loading and running a network.

use super::settings::{OnnxColors, OnnxInput, OnnxLayout, OnnxLimits};
use crate::detectors::picture::Picture;
use mobee_contract::{KindError, suggestion};
use mobee_model::file::{MIB, read};
use rten::{Dimension, Model, NodeId, RunOptions, ThreadPool};
use rten_tensor::prelude::*;
use rten_tensor::{NdTensor, Tensor};
use serde::{Deserialize, Serialize};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::Arc;

/// Maximum size of a network's file, bytes.
const MAX_FILE_BYTES: u64 = 256 * MIB;
/// Maximum width and height of a network's input, pixels.
const MAX_EDGE_PX: usize = 4096;

/// Output tensor of a network.
#[derive(Clone, Debug, PartialEq)]
pub struct NetworkOutput {
    /// Sizes of its dimensions.
    pub shape: Vec<usize>,
    /// Its numbers in row-major order.
    pub numbers: Vec<f32>,
}

/// Parameters for loading a network.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct NetworkSetup {
    /// File of the network.
    pub file: PathBuf,
    /// Format of the input.
    pub input: OnnxInput,
    /// Name of the output; `None`: the first one.
    pub output: Option<String>,
    /// Resource limits of its process.
    pub limits: OnnxLimits,
}

/// A network that is ready to run.
pub struct OnnxNetwork {
    model: Model,
    input: NodeId,
    output: NodeId,
    settings: OnnxInput,
    /// Width and height of the input, pixels.
    pub size: [usize; 2],
    options: RunOptions,
}

/// Calls the runtime and converts a panic to an error.
fn guarded<T>(call: impl FnOnce() -> T) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(call)).map_err(|panic| {
        let text = panic.downcast_ref::<String>().map(String::as_str).or(panic.downcast_ref::<&str>().copied());
        format!("the runtime gave up: {}", text.unwrap_or("no reason is given"))
    })
}

impl OnnxNetwork {
    /// Loads a network from its file.
    ///
    /// # Errors
    /// A file that does not contain a network, a missing input or output, or an input that is not
    /// an image of a known size.
    pub fn load(setup: &NetworkSetup) -> Result<OnnxNetwork, KindError> {
        let settings = &setup.input;
        let output = setup.output.as_deref();
        let at = setup.file.display();
        let bytes = read(&setup.file, MAX_FILE_BYTES)
            .map_err(|e| KindError::new("file", format!("can't read {at}: {e}"), "give a network in ONNX format"))?;
        let help = "give a whole file in ONNX format with its weights in it, exported for inference";
        let model = guarded(|| Model::load(bytes))
            .and_then(|loaded| loaded.map_err(|e| e.to_string()))
            .map_err(|e| KindError::new("file", format!("it is no network that can be run: {e}"), help))?;
        let input = pick(&model, model.input_ids(), settings.name.as_deref(), "input")?;
        let output = pick(&model, model.output_ids(), output, "output")?;
        if model.input_ids().len() != 1 {
            let what = format!("the network has {} inputs", model.input_ids().len());
            return Err(KindError::new("file", what, "export one with an image as its only input"));
        }
        let dimensions = model.node_info(input).and_then(|info| info.shape());
        let size = size(dimensions.as_deref(), settings)?;
        // Run on the detector's own thread, so that the rest of the program can use the other cores.
        let options = RunOptions::default().with_thread_pool(Some(Arc::new(ThreadPool::with_num_threads(1))));
        Ok(OnnxNetwork { model, input, output, settings: settings.clone(), size, options })
    }

    /// Runs the network on an image.
    ///
    /// # Errors
    /// A description if it can't be run or its output is not floating-point.
    pub fn run(&self, picture: &Picture) -> Result<NetworkOutput, String> {
        let input = self.input(picture);
        let options = Some(self.options.clone());
        let result = guarded(|| self.model.run(vec![(self.input, input.into())], &[self.output], options))?;
        let value = result.map_err(|e| e.to_string())?.pop().ok_or("it has no output")?;
        let tensor: Tensor<f32> = value.try_into().map_err(|_| "its numbers are not of floating point")?;
        Ok(NetworkOutput { shape: tensor.shape().to_vec(), numbers: tensor.to_vec() })
    }

    /// Converts an image to the input: stretched and scaled.
    fn input(&self, picture: &Picture) -> NdTensor<f32, 4> {
        let [width, height] = self.size;
        let planes = picture.planes(1).map(|p| p.stretched(self.size));
        let order = match self.settings.colors {
            OnnxColors::Rgb => [0, 1, 2],
            OnnxColors::Bgr => [2, 1, 0],
        };
        let scaled: Vec<Vec<f32>> = order
            .into_iter()
            .zip(self.settings.mean.iter().zip(&self.settings.std))
            .map(|(k, (mean, std))| {
                let mean = *mean as f32;
                let scale = (1.0 / std) as f32;
                planes.get(k).map(|p| p.data.iter().map(|v| (v - mean) * scale).collect()).unwrap_or_default()
            })
            .collect();
        match self.settings.layout {
            OnnxLayout::Nchw => NdTensor::from_data([1, 3, height, width], scaled.concat()),
            OnnxLayout::Nhwc => {
                let at = |k: usize| scaled.iter().map(move |c| c.get(k).copied().unwrap_or(0.0));
                NdTensor::from_data([1, height, width, 3], (0..width * height).flat_map(at).collect::<Vec<f32>>())
            }
        }
    }
}

/// Returns the input or output of this name; without a name, the first one.
fn pick(model: &Model, ids: &[NodeId], name: Option<&str>, what: &str) -> Result<NodeId, KindError> {
    let names: Vec<String> = ids.iter().map(|id| name_of(model, *id)).collect();
    let found = match name {
        Some(name) => names.iter().position(|n| n == name).and_then(|k| ids.get(k)),
        None => ids.first(),
    };
    found.copied().ok_or_else(|| match name {
        Some(name) => {
            let known: Vec<&str> = names.iter().map(String::as_str).collect();
            let problem = format!("the network has no {what} {name:?}");
            KindError::new(format!("{what}.name"), problem, suggestion(name, what, &known))
        }
        None => KindError::new("file", format!("the network has no {what}"), "export it with inputs and outputs"),
    })
}

fn name_of(model: &Model, id: NodeId) -> String {
    model.node_info(id).and_then(|info| info.name().map(str::to_owned)).unwrap_or_default()
}

/// Determines width and height of the input from the network's dimensions and the settings.
fn size(dimensions: Option<&[Dimension]>, settings: &OnnxInput) -> Result<[usize; 2], KindError> {
    let shown = |dimensions: &[Dimension]| {
        let each = dimensions.iter().map(|d| match d {
            Dimension::Fixed(n) => n.to_string(),
            Dimension::Symbolic(name) => name.clone(),
        });
        each.collect::<Vec<_>>().join(", ")
    };
    let own = match dimensions {
        None => [None, None],
        Some(dimensions) => {
            let [batch, channels, height, width] = match (dimensions, settings.layout) {
                ([n, c, h, w], OnnxLayout::Nchw) | ([n, h, w, c], OnnxLayout::Nhwc) => [n, c, h, w].map(fixed),
                _ => {
                    let what = format!("the network's input has the dimensions [{}]", shown(dimensions));
                    let help = "give one whose input has four: image, channel, row, column, or with the channel last";
                    return Err(KindError::new("input.layout", what, help));
                }
            };
            if batch.is_some_and(|n| n != 1) || channels.is_some_and(|n| n != 3) {
                let what = format!("the network's input has the dimensions [{}]", shown(dimensions));
                let help = "give one that takes one image of three colors; for the channel last: layout = \"nhwc\"";
                return Err(KindError::new("input.layout", what, help));
            }
            [width, height]
        }
    };
    let mut size = [0; 2];
    for (k, (to, own)) in size.iter_mut().zip(own).enumerate() {
        let given = settings.size.map(|s| s[k]);
        *to = match (own, given) {
            (Some(own), Some(given)) if own != given => {
                let what = format!("the network's input is {own} pixels {}", ["wide", "high"][k]);
                return Err(KindError::new("input.size", what, "leave the size out, or give the network's"));
            }
            (Some(n), _) | (None, Some(n)) => n,
            (None, None) => {
                let help = "give width and height in pixels: size = [160, 120]";
                return Err(KindError::new("input.size", "the network leaves its input's size open", help));
            }
        };
    }
    if size.iter().any(|n| !(1..=MAX_EDGE_PX).contains(n)) {
        let what = format!("images of {}x{} pixels are not supported", size[0], size[1]);
        return Err(KindError::new("input.size", what, "give 1 to 4096 pixels"));
    }
    Ok(size)
}

fn fixed(of: &Dimension) -> Option<usize> {
    match of {
        Dimension::Fixed(n) => Some(*n),
        Dimension::Symbolic(_) => None,
    }
}

"""ONNX Runtime: two graphs of its fused operators, weights f32 or quantised dynamically to int8.

usage: contend_onnx.py MODEL SCENE PRECISION THREADS
"""
import sys
import tempfile
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto, helper, numpy_helper
from onnxruntime.quantization import QuantType, quantize_dynamic

import forward
import serve
import work

OPSET = 23  # the first with RMSNormalization


class Operations:
    """Each operation adds its nodes to a graph; a value is its name."""

    def __init__(self, job):
        self.config, self.views = job.config, job.views
        self.weights = forward.split_cross(job.weights)
        self.nodes, self.constants = [], {}

    def node(self, kind, inputs, outputs=1, **attributes):
        names = [f"{kind}_{len(self.nodes)}_{i}" for i in range(outputs)]
        self.nodes.append(helper.make_node(kind, inputs, names, **attributes))
        return names[0] if outputs == 1 else names

    def constant(self, name, numbers):
        self.constants.setdefault(name, numpy_helper.from_array(np.ascontiguousarray(numbers), name))
        return name

    def linear(self, name, x):
        return self.node("MatMul", [x, self.constant(name, self.weights[name].T)])

    def norm(self, name, x):
        return self.node("LayerNormalization", [x, self.constant(name, self.weights[name])],
                         epsilon=self.config.norm_eps)

    def shape(self, x, *sizes):
        name = "shape_" + "_".join(map(str, sizes)).replace("-", "m")
        return self.node("Reshape", [x, self.constant(name, np.array(sizes, np.int64))])

    def head_norm(self, name, x):
        heads, dim = self.config.heads, self.config.dim
        parts = self.shape(x, 0, -1, heads, dim // heads)
        normed = self.node("RMSNormalization", [parts, self.constant(name, self.weights[name])],
                           epsilon=self.config.norm_eps)
        return self.shape(normed, 0, -1, dim)

    def attention(self, query, key, value):
        return self.node("MultiHeadAttention", [query, key, value], domain="com.microsoft",
                         num_heads=self.config.heads)

    def join_views(self, x):
        return self.shape(x, 1, -1, self.config.dim)

    def part_views(self, x):
        return self.shape(x, self.views, -1, self.config.dim)

    def split(self, x, count):
        return self.node("Split", [x], count, axis=-1, num_outputs=count)

    def gelu(self, x):
        return self.node("Gelu", [x])

    def add(self, x, y):
        return self.node("Add", [x, y])

    def model(self, inputs, outputs):
        """inputs: name -> shape; outputs: names."""
        def value(name, shape):
            return helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)
        graph = helper.make_graph(self.nodes, "dvsm",
                                  [value(name, shape) for name, shape in inputs.items()],
                                  [value(name, None) for name in outputs],
                                  list(self.constants.values()))
        domains = [helper.make_opsetid("", OPSET), helper.make_opsetid("com.microsoft", 1)]
        return helper.make_model(graph, opset_imports=domains, ir_version=10)


def cache_names(layers):
    return [(f"key_{i}", f"value_{i}") for i in range(layers)]


def make_reconstruct(job):
    ops = Operations(job)
    cache = forward.reconstruct(ops, job.config.layers, "ray", "rgb")
    names = [name for pair in cache for name in pair]
    return ops.model({"ray": job.context_ray.shape, "rgb": job.context_rgb.shape}, names), names


def make_render(job):
    ops = Operations(job)
    names = cache_names(job.config.layers)
    numbers = forward.render(ops, "ray", names)
    keys = {name: [1, job.views * job.tokens, job.config.dim] for pair in names for name in pair}
    return ops.model({"ray": job.target_ray.shape, **keys}, [numbers])


def open_session(model, precision, threads, folder):
    path = str(Path(folder) / "f32.onnx")
    onnx.save(model, path, save_as_external_data=True, location="f32.weights")
    if precision == "int8":
        quantised = str(Path(folder) / "int8.onnx")
        quantize_dynamic(path, quantised, per_channel=True, weight_type=QuantType.QInt8,
                         op_types_to_quantize=["MatMul"], use_external_data_format=True,
                         extra_options={"DefaultTensorType": TensorProto.FLOAT})
        path = quantised
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.log_severity_level = 3
    return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])


def main():
    model, scene, precision, threads = sys.argv[1:]
    job = work.read(model, scene)
    sessions = []
    graph, cached = make_reconstruct(job)
    for made in (graph, make_render(job)):
        with tempfile.TemporaryDirectory() as folder:
            sessions.append(open_session(made, precision, int(threads), folder))
    feeds = {"ray": job.target_ray}
    names = [name for pair in cache_names(job.config.layers) for name in pair]

    def reconstruct():
        outputs = sessions[0].run(cached, {"ray": job.context_ray, "rgb": job.context_rgb})
        feeds.update(zip(names, outputs))

    def render():
        numbers, = sessions[1].run(None, feeds)
        return lambda: numbers

    serve.serve(f"ONNX Runtime {onnxruntime.__version__}", reconstruct, render)


if __name__ == "__main__":
    main()

"""What an exported network costs, counted in its ONNX file: `python cost.py FILE...`."""

from __future__ import annotations

import json
import math
import sys
import tomllib
from pathlib import Path

import numpy as np
import onnx
from onnx import numpy_helper, shape_inference

WEIGHTED = ("Conv", "ConvTranspose", "Gemm", "MatMul")
PASSED_ON = ("Cast", "Concat", "DequantizeLinear", "Identity", "Transpose", "Reshape")


def cost(path: Path) -> dict[str, int]:
    """Multiply-accumulates of one frame in the graph; parameters, and those that are not 0, of the
    whole file, the pillar features in its metadata included.

    Parameters are weights and biases of convolutions and matrix products, not the scales of a
    quantised network.
    """
    model = shape_inference.infer_shapes(onnx.load(path), strict_mode=True, data_prop=True)
    graph = model.graph
    made_by = {output: node for node in graph.node for output in node.output}
    stored = {tensor.name: tensor for tensor in graph.initializer}
    shapes = {tensor.name: tuple(tensor.dims) for tensor in graph.initializer}
    for value in (*graph.input, *graph.value_info, *graph.output):
        shapes[value.name] = tuple(d.dim_value for d in value.type.tensor_type.shape.dim)

    def values(name: str) -> np.ndarray | None:
        """What is stored behind an input, less its zero point; `None` where it is computed."""
        if name in stored:
            return numpy_helper.to_array(stored[name])
        node = made_by.get(name)
        if node is None or node.op_type not in PASSED_ON:
            return None
        array = values(node.input[0])
        if array is not None and node.op_type == "Concat":
            return np.concatenate([values(part).reshape(-1) for part in node.input])
        if array is not None and node.op_type == "DequantizeLinear" and len(node.input) > 2:
            axis = next((a.i for a in node.attribute if a.name == "axis"), 1)
            zero = values(node.input[2])
            if zero.ndim:
                zero = zero.reshape([-1 if i == axis else 1 for i in range(array.ndim)])
            array = array.astype(np.int64) - zero
        return array

    operations, parameters = 0, {}
    for node in graph.node:
        if node.op_type in WEIGHTED:
            operations += multiply_accumulates(node, *(shapes[name] for name in (*node.input[:2], node.output[0])))
        inputs = node.input[1:] if node.op_type in WEIGHTED else ()
        parameters |= {name: array for name in inputs if name and (array := values(name)) is not None}
    arrays = list(parameters.values())
    for entry in model.metadata_props:
        if entry.key == "pillar_features":
            arrays += [np.array(numbers) for numbers in tomllib.loads(entry.value).values()]
    return {
        "multiply_accumulates": operations,
        "parameters": sum(array.size for array in arrays),
        "nonzero_parameters": sum(int(np.count_nonzero(array)) for array in arrays),
    }


def multiply_accumulates(node: onnx.NodeProto, data: tuple, weight: tuple, output: tuple) -> int:
    """Of one node, from the shapes of its two factors and of its output."""
    if node.op_type == "Conv":  # weight [outputs, inputs of a group, ...]
        return math.prod(output) * math.prod(weight[1:])
    if node.op_type == "ConvTranspose":  # weight [inputs, outputs of a group, ...]
        return math.prod(data) * math.prod(weight[1:])
    transposed = any(a.name == "transA" and a.i for a in node.attribute)
    return math.prod(output) * data[-2 if transposed else -1]


if __name__ == "__main__":
    for file in sys.argv[1:]:
        print(file, json.dumps(cost(Path(file))))

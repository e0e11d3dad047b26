"""A network with its weights shuffled: the check that a benefit comes from what it learned.

Every weight tensor keeps its values and loses their order, by a seed. The folder that is written
holds both networks with their cards, so it can be given to `covista demo --models`.
"""

import argparse
import hashlib
import re
import shutil
import tomllib
from pathlib import Path

import numpy as np
import onnx
from onnx import numpy_helper

PILLAR_FEATURES = "pillar_features"


def shuffle(model: onnx.ModelProto, seed: int) -> None:
    """Permutes the values of every floating-point initializer of `model`, and of a detector's pillar
    features in the metadata, in place."""
    rng = np.random.default_rng(seed)
    for tensor in model.graph.initializer:
        values = numpy_helper.to_array(tensor)
        if values.dtype.kind == "f" and values.size > 1:
            mixed = rng.permutation(values.ravel()).reshape(values.shape)
            tensor.CopyFrom(numpy_helper.from_array(mixed, tensor.name))
    for entry in model.metadata_props:
        if entry.key == PILLAR_FEATURES:
            arrays = {name: np.array(values) for name, values in tomllib.loads(entry.value).items()}
            mixed = {name: rng.permutation(a.ravel()).reshape(a.shape).tolist() for name, a in arrays.items()}
            entry.value = "".join(f"{name} = {values}\n" for name, values in mixed.items())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("id", help="which network, such as pointpillars")
    parser.add_argument("--models", type=Path, default=Path(__file__).parent.parent)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()

    args.out.mkdir(parents=True, exist_ok=True)
    for path in [*args.models.glob("*.onnx"), *args.models.glob("*.toml")]:
        shutil.copy(path, args.out)
    network = args.out / f"{args.id}.onnx"
    model = onnx.load(network)
    shuffle(model, args.seed)
    onnx.save(model, network)
    card = args.out / f"{args.id}.toml"
    digest = hashlib.sha256(network.read_bytes()).hexdigest()
    card.write_text(re.sub(r'sha256 = "\w+"', f'sha256 = "{digest}"', card.read_text()))


if __name__ == "__main__":
    main()

"""The LSTM of covista-planner against PyTorch: writes planner/src/learning/nn/lstm.json.

Sequences of different lengths through torch.nn.LSTM, packed; the loss is a weighted sum of the last
hidden states, so that its gradient is simple to state. Run: python tests/oracles/lstm.py (torch 2).
"""

import json
import pathlib

import torch

INPUTS, HIDDEN, LENGTHS = 3, 5, [4, 2, 2, 1]

torch.manual_seed(0)
torch.set_default_dtype(torch.float64)
lstm = torch.nn.LSTM(INPUTS, HIDDEN, batch_first=True)
with torch.no_grad():
    for parameter in lstm.parameters():
        parameter.copy_(torch.empty_like(parameter).uniform_(-0.9, 0.9))
sequences = [torch.randn(length, INPUTS) for length in LENGTHS]
packed = torch.nn.utils.rnn.pack_sequence(sequences)
_, (last, _) = lstm(packed)
factors = torch.randn(len(LENGTHS), HIDDEN)
(last[0] * factors).sum().backward()


def joined(of):
    """Rows for the hidden units, then for the inputs; PyTorch keeps them transposed and apart."""
    return torch.cat([of(lstm.weight_hh_l0).T, of(lstm.weight_ih_l0).T]).flatten().tolist()


fixture = {
    "inputs": INPUTS,
    "hidden": HIDDEN,
    "lengths": LENGTHS,
    "sequences": [sequence.flatten().tolist() for sequence in sequences],
    "weight": joined(lambda p: p.detach()),
    "bias": (lstm.bias_ih_l0 + lstm.bias_hh_l0).detach().tolist(),
    "last": last[0].flatten().tolist(),
    "factors": factors.flatten().tolist(),
    "weight_gradient": joined(lambda p: p.grad),
    "bias_gradient": lstm.bias_ih_l0.grad.tolist(),
}
path = pathlib.Path(__file__).parents[2] / "planner/src/learning/nn/lstm.json"
path.write_text(json.dumps(fixture) + "\n")

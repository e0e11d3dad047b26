"""One update of Alg. 2 in PyTorch, to compare with `covista bench training`.

The same networks and the same work: target actor and target critic at s', critic and actor at s with
their gradients, Adam, soft target updates; minibatch 64, K neighbours, one thread.
Run: python tests/oracles/update_cost.py [K] (torch 2).
"""

import copy
import statistics
import sys
import time

import torch
from torch import nn

ROWS, OWN, NEIGHBOUR, ACTIONS, HIDDEN = 64, 13, 17, 4, 128
NEIGHBOURS = int(sys.argv[1]) if len(sys.argv) > 1 else 8

torch.manual_seed(0)
torch.set_num_threads(1)


class Network(nn.Module):
    """LSTM over neighbours, its last state beside the own features, one hidden layer, values."""

    def __init__(self, inputs, own, values):
        super().__init__()
        self.lstm = nn.LSTM(inputs, HIDDEN, batch_first=True)
        self.hidden = nn.Linear(HIDDEN + own, HIDDEN)
        self.head = nn.Linear(HIDDEN, values)

    def around(self, neighbours):
        return self.lstm(neighbours)[1][0][0]

    def values(self, around, own):
        return self.head(torch.relu(self.hidden(torch.cat([around, own], 1))))


def all_values(critic, neighbours, own):
    """Q of every own action, the LSTM read once."""
    around = critic.around(neighbours)
    every = torch.eye(ACTIONS).repeat(ROWS, 1)
    joined = torch.cat([own.repeat_interleave(ACTIONS, 0), every], 1)
    return critic.values(around.repeat_interleave(ACTIONS, 0), joined).view(ROWS, ACTIONS)


actor = Network(NEIGHBOUR, OWN, ACTIONS - 1)
critic = Network(NEIGHBOUR + ACTIONS, OWN + ACTIONS, 1)
targets = copy.deepcopy((actor, critic))
adams = [torch.optim.Adam(net.parameters(), lr=1e-3, fused=True) for net in (actor, critic)]
own, next_own = torch.rand(2, ROWS, OWN)
around, next_around = torch.rand(2, ROWS, NEIGHBOURS, NEIGHBOUR + ACTIONS)
action = torch.randint(ACTIONS, (ROWS, 1))
reward = torch.rand(ROWS)


def update():
    with torch.no_grad():
        logits = targets[0].values(targets[0].around(next_around[..., :NEIGHBOUR]), next_own)
        values = all_values(targets[1], next_around, next_own)
        y = reward + 0.9 * (logits.softmax(1) * values[:, :3]).sum(1)
    values = all_values(critic, around, own)
    critic_loss = ((values.gather(1, action)[:, 0] - y) ** 2).mean()
    logits = actor.values(actor.around(around[..., :NEIGHBOUR]), own)
    actor_loss = -(logits.softmax(1) * values.detach()[:, :3]).sum(1).mean()
    for loss, adam, net, target in zip(
        (actor_loss, critic_loss), adams, (actor, critic), targets
    ):
        adam.zero_grad()
        loss.backward()
        adam.step()
        with torch.no_grad():
            torch._foreach_lerp_(list(target.parameters()), list(net.parameters()), 0.01)


times = []
for _ in range(200):
    start = time.perf_counter()
    update()
    times.append(time.perf_counter() - start)
median_ms = 1e3 * statistics.median(times[20:])
print(f"K {NEIGHBOURS}: median {median_ms:.2f} ms, {1e3 / median_ms:.0f} updates/s, torch {torch.__version__}")

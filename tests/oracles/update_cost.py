"""One update of Alg. 2 in PyTorch: the other side of `covista bench training --against pytorch`.

The same networks and the same work: target actor and target critic at s', critic and actor at s with
their gradients, Adam, soft target updates; one thread.

covista starts it without arguments, writes one JSON object a line to its standard input and reads
one from its output for each:

    {"do": "open", "minibatch": 64, "own": 13, "neighbours": K, "neighbour": 17, "hidden": 128}
        -> {"versions": ...}
    {"do": "time", "updates": N, "warm_up": W} -> {"seconds": [...]}, without the first W

An answer {"error": "..."} ends the run.
Alone: python tests/oracles/update_cost.py K (torch 2).
"""

import copy
import json
import statistics
import sys
import time

ACTIONS = 4
SIZES = {"minibatch": 64, "own": 13, "neighbour": 17, "hidden": 128}


def opened(minibatch, own, neighbours, neighbour, hidden):
    """An update of networks of these sizes on random transitions."""
    import torch
    from torch import nn

    class Network(nn.Module):
        """LSTM over neighbours, its last state beside the own features, one hidden layer, values."""

        def __init__(self, inputs, own, values):
            super().__init__()
            self.lstm = nn.LSTM(inputs, hidden, batch_first=True)
            self.hidden = nn.Linear(hidden + own, hidden)
            self.head = nn.Linear(hidden, values)

        def around(self, neighbours):
            return self.lstm(neighbours)[1][0][0]

        def values(self, around, own):
            return self.head(torch.relu(self.hidden(torch.cat([around, own], 1))))

    def all_values(critic, neighbours, own):
        """Q of every own action, the LSTM read once."""
        around = critic.around(neighbours)
        every = torch.eye(ACTIONS).repeat(minibatch, 1)
        joined = torch.cat([own.repeat_interleave(ACTIONS, 0), every], 1)
        values = critic.values(around.repeat_interleave(ACTIONS, 0), joined)
        return values.view(minibatch, ACTIONS)

    torch.manual_seed(0)
    torch.set_num_threads(1)
    actor = Network(neighbour, own, ACTIONS - 1)
    critic = Network(neighbour + ACTIONS, own + ACTIONS, 1)
    targets = copy.deepcopy((actor, critic))
    adams = [torch.optim.Adam(net.parameters(), lr=1e-3, fused=True) for net in (actor, critic)]
    state, next_state = torch.rand(2, minibatch, own)
    around, next_around = torch.rand(2, minibatch, neighbours, neighbour + ACTIONS)
    action = torch.randint(ACTIONS, (minibatch, 1))
    reward = torch.rand(minibatch)

    def update():
        with torch.no_grad():
            logits = targets[0].values(targets[0].around(next_around[..., :neighbour]), next_state)
            values = all_values(targets[1], next_around, next_state)
            y = reward + 0.9 * (logits.softmax(1) * values[:, :3]).sum(1)
        values = all_values(critic, around, state)
        critic_loss = ((values.gather(1, action)[:, 0] - y) ** 2).mean()
        logits = actor.values(actor.around(around[..., :neighbour]), state)
        actor_loss = -(logits.softmax(1) * values.detach()[:, :3]).sum(1).mean()
        for loss, adam, net, target in zip(
            (actor_loss, critic_loss), adams, (actor, critic), targets
        ):
            adam.zero_grad()
            loss.backward()
            adam.step()
            with torch.no_grad():
                torch._foreach_lerp_(list(target.parameters()), list(net.parameters()), 0.01)

    return update, f"torch {torch.__version__}"


def seconds(update, updates, warm_up):
    times = []
    for _ in range(warm_up + updates):
        start = time.perf_counter()
        update()
        times.append(time.perf_counter() - start)
    return times[warm_up:]


def serve():
    update = None
    for line in sys.stdin:
        request = json.loads(line)
        try:
            if request.pop("do") == "open":
                update, versions = opened(**request)
                answer = {"versions": versions}
            else:
                answer = {"seconds": seconds(update, **request)}
        except Exception as error:
            answer = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps(answer), flush=True)


if len(sys.argv) > 1:
    update, versions = opened(neighbours=int(sys.argv[1]), **SIZES)
    median = statistics.median(seconds(update, 180, 20))
    print(f"K {sys.argv[1]}: median {1e3 * median:.2f} ms, {1 / median:.0f} updates/s, {versions}")
else:
    serve()

"""Networks as peers, in jax: a Kolmogorov-Arnold network of splines (the kind that Zhou 2025 takes) and an LSTM (a network with memory).

Both learn scaled features side by side, one row for each mean, in the order of time. The ridge is the one of three that leaves least on the last fifth of
the train run; then all of it is learnt. The descent is L-BFGS, from weights drawn by a seed.
"""
import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import minimize

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_platforms", "cpu")

RIDGES = (1e-4, 1e-3, 1e-2)
STEPS = 200
# Splines of an edge: hats on so many knots, over three deviations of its input.
KNOTS = 8
# Nodes between input and output of the first, and cells of the second.
HIDDEN = 4
CELLS = 8


def edge(weights, x):
    """Functions of one layer: for each pair of nodes a line through silu and hats on knots. weights: (in, out, knots + 1); x: (rows, in)."""
    knots = jnp.linspace(-3.0, 3.0, KNOTS)
    hats = jnp.maximum(0.0, 1.0 - jnp.abs(x[:, :, None] - knots) / (knots[1] - knots[0]))
    basis = jnp.concatenate([hats, jax.nn.silu(x)[:, :, None]], axis=2)
    return jnp.einsum("nik,iok->no", basis, weights)


def kan_shapes(inputs):
    return [(inputs, HIDDEN, KNOTS + 1), (HIDDEN, 1, KNOTS + 1)]


def kan(parts, x):
    return edge(parts[1], edge(parts[0], x))[:, 0]


def lstm_shapes(inputs):
    return [(inputs, 4 * CELLS), (CELLS, 4 * CELLS), (4 * CELLS,), (CELLS,)]


def lstm(parts, x):
    into, back, bias, out = parts

    def step(state, row):
        hidden, cell = state
        i, f, o, g = jnp.split(row @ into + hidden @ back + bias, 4)
        cell = jax.nn.sigmoid(f + 1.0) * cell + jax.nn.sigmoid(i) * jnp.tanh(g)
        hidden = jax.nn.sigmoid(o) * jnp.tanh(cell)
        return (hidden, cell), hidden @ out

    zero = jnp.zeros(CELLS)
    return jax.lax.scan(step, (zero, zero), x)[1]


class Network:
    """A network behind the interface of scikit-learn."""

    def __init__(self, network, shapes, seed):
        self.network, self.shapes, self.seed = network, shapes, seed

    def parts(self, flat):
        sizes = [int(np.prod(s)) for s in self.of]
        edges = np.cumsum([0] + sizes)
        return [flat[a:b].reshape(s) for a, b, s in zip(edges, edges[1:], self.of)]

    def learn(self, x, y, ridge):
        rng = np.random.default_rng(self.seed)
        start = np.concatenate([rng.normal(0.0, 0.3 / np.sqrt(s[0]), int(np.prod(s))) for s in self.of])
        x, y = jnp.asarray(x), jnp.asarray(y)
        loss = jax.jit(jax.value_and_grad(lambda w: jnp.mean((self.network(self.parts(w), x) - y) ** 2) + ridge * jnp.mean(w**2)))
        found = minimize(lambda w: tuple(np.asarray(v) for v in loss(w)), start, jac=True, method="L-BFGS-B", options={"maxiter": STEPS})
        return found.x

    def fit(self, x, y):
        self.of = self.shapes(x.shape[1])
        held = len(y) - len(y) // 5

        def left(ridge):
            w = self.learn(x[:held], y[:held], ridge)
            return float(np.mean((np.asarray(self.network(self.parts(w), jnp.asarray(x)))[held:] - y[held:]) ** 2))

        self.w = self.learn(x, y, min(RIDGES, key=left))
        return self

    def predict(self, x):
        return np.asarray(self.network(self.parts(self.w), jnp.asarray(x)))


def peers(seed):
    return {"KAN": lambda: Network(kan, kan_shapes, seed), "LSTM": lambda: Network(lstm, lstm_shapes, seed)}

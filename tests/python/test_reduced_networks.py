"""Networks of capacitors and inductors and chains of vessels against their reduced forms."""

import time

import numpy as np
import pytest

import smpl
from reduced import HEAD, follows, solved


def network(seed, nodes, loops, cut_sets):
    """A random network of capacitors, resistors and inductors.

    Capacitors connect each node to the ground, and some pairs of nodes (loops of capacitors). Inductors form stars of
    three whose middle has nothing else (cut sets of inductors).

    Returns the text with the equations of all elements, and the start and the rates of the manually reduced form. Node
    potentials follow from the matrix of capacitances, potentials of the stars from the sum of their currents.
    """
    rng = np.random.default_rng(seed)

    def draw():
        return round(float(rng.uniform(0.5, 2)), 3)

    def potential(a):
        return f"e{a}" if a >= 0 else "0[V]"

    pairs = [(i, int(rng.integers(nodes))) for i in range(nodes)]
    capacitors = [(i, -1, draw()) for i in range(nodes)]
    while len(capacitors) < nodes + loops:
        a, b = rng.choice(nodes, 2, replace=False)
        capacitors.append((int(a), int(b), draw()))
    resistors = [(a, b if a != b else -1, draw()) for a, b in pairs]
    stars = [[(int(a), draw(), draw()) for a in rng.choice(nodes, 3, replace=False)] for _ in range(cut_sets)]
    text = "".join(f"var e{i} : V\n" for i in range(nodes))
    flows = [[] for _ in range(nodes)]
    for k, (a, b, C) in enumerate(capacitors):
        text += f"state v{k} : V = 0\nvar c{k} : A\neq {C}[A s/V]*d/dt v{k} = c{k}\n"
        text += f"eq v{k} = {potential(a)} - {potential(b)}\n"
        flows[a].append(f"- c{k}")
        if b >= 0:
            flows[b].append(f"+ c{k}")
    for a, b, R in resistors:
        term = f"({potential(a)} - {potential(b)})/{R}[V/A]"
        flows[a].append(f"- {term}")
        if b >= 0:
            flows[b].append(f"+ {term}")
    for s, star in enumerate(stars):
        text += f"var m{s} : V\neq {' + '.join(f'j{s}_{n}' for n in range(3))} = 0[A]\n"
        for n, (a, L, R) in enumerate(star):
            text += f"state j{s}_{n} : A = 0\neq {L}[V s/A]*d/dt j{s}_{n} = e{a} - m{s} - {R}[V/A]*j{s}_{n}\n"
            flows[a].append(f"- j{s}_{n}")
    for i in range(nodes):
        source = f"sin({i + 1}*t/1[s])*1[A]" if i < 2 else "0[A]"
        text += f"eq {source} {' '.join(flows[i])} = 0[A]\n"

    A = np.zeros((nodes, nodes))
    for a, b, C in capacitors:
        edge = np.zeros(nodes)
        edge[a] = 1
        if b >= 0:
            edge[b] = -1
        A += C * np.outer(edge, edge)

    def rates(t, z):
        e, j = z[:nodes], z[nodes:].reshape(-1, 3)
        flow, dj = np.zeros(nodes), np.zeros_like(j)
        flow[:2] = np.sin(t), np.sin(2 * t)
        for a, b, R in resistors:
            i = (e[a] - (e[b] if b >= 0 else 0)) / R
            flow[a] -= i
            if b >= 0:
                flow[b] += i
        for s, star in enumerate(stars):
            at, L, R = (np.array(list(one)) for one in zip(*star, strict=True))
            free = (e[at] - R * j[s]) / L
            dj[s] = free - (free.sum() / (1 / L).sum()) / L
            np.subtract.at(flow, at, j[s])
        return np.r_[np.linalg.solve(A, flow), dj.ravel()]

    return text, np.zeros(nodes + 3 * cut_sets), rates


@pytest.mark.parametrize(("seed", "nodes", "loops", "cut_sets"), [
    (1, 2, 1, 0), (2, 3, 2, 0), (3, 3, 0, 1), (4, 4, 3, 1), (5, 5, 4, 2), (6, 8, 8, 3), (7, 12, 10, 5), (8, 20, 20, 8),
])  # fmt: skip
def test_networks_with_loops_of_capacitors_and_cut_sets_of_inductors_follow_their_reduced_form(
    seed, nodes, loops, cut_sets
):
    text, start, rates = network(seed, nodes, loops, cut_sets)
    end = solved(rates, start, 3.0)
    expected = {f"e{i}": end[i] for i in range(nodes)}
    expected |= {f"j{s}_{n}": end[nodes + 3 * s + n] for s in range(cut_sets) for n in range(3)}
    follows(text, 3.0, expected, 2e-6)


def chain(vessels):
    """Gas vessels of different volume in contact, one after another, fed at one end."""
    last, total = vessels, vessels - 1
    return f"""set k = 1..{last}
    set j = 1..{total}
    state n[i in k] : mol = 2/(1 + i/{last})
    var p[k] : mol
    var w[j] : mol/s
    eq d/dt n[1] = 1[mol/s] - w[1]
    eq d/dt n[i] = w[i-1] - w[i] for i in 2..{total}
    eq d/dt n[{last}] = w[{total}]
    eq p[i] = n[i]*(1 + i/{last}) for i in k
    eq p[i] = p[i+1] for i in j
    """


@pytest.mark.parametrize("vessels", [20, 200, 2000])
def test_a_chain_of_vessels_has_one_pressure(vessels):
    """p = N/sum(1/(1 + i/n)), where the total amount N grows by 1 mol/s; w from the sum of the rates ahead."""
    share = 1 / (1 + np.arange(1, vessels + 1) / vessels)
    share /= share.sum()
    middle = vessels // 2
    start = 2 / (1 + np.arange(1, vessels + 1) / vessels)
    expected = {f"n[{i + 1}]": (start.sum() + 3) * share[i] for i in (0, middle, vessels - 1)}
    follows(chain(vessels), 3.0, expected | {f"w[{middle}]": 1 - share[:middle].sum()})


def test_ten_times_as_many_vessels_take_about_ten_times_as_long():
    def seconds(vessels):
        model = smpl.compile(source=HEAD.format(step=0.1, steps=10_000) + chain(vessels))
        env = smpl.Env(model, method="rosenbrock")
        env.reset(seed=0)
        best = np.inf
        for _ in range(20):
            begin = time.perf_counter()
            env.step([])
            best = min(best, time.perf_counter() - begin)
        return best

    assert seconds(2000) < 40 * seconds(200)

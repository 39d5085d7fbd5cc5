"""What allantools gives on the data of the test `as_allantools` (desktop/data/src/numeric/allan.rs).

Prints the lines that stand in allan.csv beside it: pip install allantools; python3 allan.py > allan.csv
"""
import allantools
import numpy


def data(n):
    """White noise, flicker-like drift and a random walk, from a generator that any language can repeat."""
    x, walk, slow, out = 1, 0.0, 0.0, []
    for _ in range(n):
        x = (x * 6364136223846793005 + 1442695040888963407) % 2**64
        white = (x >> 33) / 2**31 - 0.5
        x = (x * 6364136223846793005 + 1442695040888963407) % 2**64
        step = (x >> 33) / 2**31 - 0.5
        walk += 0.002 * step
        slow = 0.99 * slow + 0.05 * step
        out.append(3.0 + white + slow + walk)
    return numpy.array(out)


m = [1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 3000]
taus, deviations, _, counts = allantools.oadev(data(10000), rate=2.0, data_type="freq", taus=[k / 2.0 for k in m])
print("# allantools", allantools.__version__, "oadev of 10000 values, two a second")
print("tau_s,deviation,pairs")
for t, d, n in zip(taus, deviations, counts):
    print(f"{t},{d!r},{n}".replace("np.float64(", "").replace(")", ""))

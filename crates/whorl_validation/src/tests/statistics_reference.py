"""Reference numbers for statistics.rs: pip install statsmodels; python statistics_reference.py >> statistics.rs"""

import numpy as np
from scipy.stats import chi2
from statsmodels.stats.diagnostic import acorr_ljungbox

state, previous, x = 12345, 0.0, []
for _ in range(400):
    state = (state * 6364136223846793005 + 1442695040888963407) % 2**64
    previous = 0.3 * previous + (state >> 11) / 2**53 - 0.5
    x.append(previous)
x = np.array(x)

rows = acorr_ljungbox(x, lags=[1, 5, 25])
print("const REFERENCE_LJUNG_BOX: [(u32, f64, f64); 3] = [")
for lags, row in rows.iterrows():
    print(f"    ({lags}, {row['lb_stat']:.15e}, {row['lb_pvalue']:.15e}),")
print("];")
print(f"const REFERENCE_LIMIT_25: f64 = {chi2.ppf(0.99, 25):.15e};")
c = x - x.mean()
r = [float(c[: len(c) - k] @ c[k:] / (c @ c)) for k in range(4)]
print("const REFERENCE_AUTOCORRELATION: [f64; 4] = [" + ", ".join(f"{v:.15e}" for v in r) + "];")
u = np.append(x[1:], 0.0)
u = u - u.mean()
value = float(u[:-1] @ c[1:] / np.sqrt((u @ u) * (c @ c)))
print(f"const REFERENCE_CROSS_CORRELATION: f64 = {value:.15e};")

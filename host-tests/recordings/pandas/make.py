"""Writes the two Parquet files beside it, as pandas and pyarrow do: a recording, and a table of another program.

    pip install pandas pyarrow && python3 make.py
"""
import numpy as np
import pandas as pd

rows = 300
k = np.arange(rows)
temperature = 20.0 + 0.125 * k
rate = 1.5 + 0.01 * k + 0.001 * (k * 7919 % 101)

recording = pd.DataFrame({"time_s": k.astype(float), "temp_x_c": temperature, "rate_x_dph": rate})
recording.loc[7, "rate_x_dph"] = np.nan
recording.attrs = {"hrg-recording": "2", "unit": "PANDAS-1", "thermometer": "sensor", "rate_unit": "deg/h", "power_on_s": 0}
recording.to_parquet("recording.parquet")

table = pd.DataFrame(
    {
        "when": pd.Timestamp("2026-05-01T12:00:00.25") + pd.to_timedelta(k * 40, unit="ms"),
        "imu": np.where(k % 2 == 0, "left", "right"),
        "gyro": (rate / 206264.80625).astype(np.float32),
        "celsius": pd.array([None if j == 4 else int(t) for j, t in zip(k, temperature)], dtype="Int16"),
        "shapes": [[1, 2]] * rows,
    }
)
table.to_parquet("table.parquet", compression="zstd", index=False)

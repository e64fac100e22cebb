"""Recordings as arrays and frames. Truth: the CSV file that the program exports, and what was put in."""

import gc

import numpy as np
import pandas
import polars
import pytest
import whorl


@pytest.fixture(scope="module")
def recording(run):
    return whorl.read(run, platform="whorl_1")


@pytest.fixture(scope="module")
def exported(run, program, tmp_path_factory):
    folder = tmp_path_factory.mktemp("csv")
    program("export", "csv", run, "--platform", "whorl_1", "--out", folder)
    return polars.read_csv(folder / "whorl_1.csv", infer_schema_length=None)


@pytest.mark.parametrize(
    ("key", "columns"),
    [
        ("gyro", ["gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s"]),
        ("accelerometer", ["force_x_m_s2", "force_y_m_s2", "force_z_m_s2"]),
        ("vector_1", ["vector_1_x", "vector_1_y", "vector_1_z"]),
        ("wheel_speed", ["wheel_x_rad_s", "wheel_y_rad_s", "wheel_z_rad_s"]),
        ("wheel_torque_command", ["wheel_x_n_m", "wheel_y_n_m", "wheel_z_n_m"]),
        ("bus_voltage", ["bus_v"]),
        ("true_attitude", ["true_q_w", "true_q_x", "true_q_y", "true_q_z"]),
    ],
)
def test_channels_are_those_of_the_exported_file(recording, exported, key, columns):
    rows = exported.select(["time_s", *columns]).drop_nulls().to_numpy()
    time_s, values, _, _ = recording[key]
    assert len(rows) > 50 and values.shape == ((len(rows),) if len(columns) == 1 else (len(rows), len(columns)))
    np.testing.assert_array_equal(time_s, rows[:, 0])
    np.testing.assert_array_equal(values.reshape(len(rows), -1), rows[:, 1:])


def test_a_frame_of_the_exported_columns_is_the_recording_again(recording, exported):
    again = whorl.Recording.from_frame(
        exported, model=recording.model, reference_world={"vector_1": recording.reference_world()}
    )
    assert again.keys() == recording.keys()
    for key in recording:
        np.testing.assert_array_equal(again[key].time_s, recording[key].time_s)
        np.testing.assert_allclose(again[key].values, recording[key].values, rtol=0, atol=1e-14)


def test_arrays_are_the_recordings_own_memory_and_outlive_it(run):
    recording = whorl.read(run, platform="whorl_1")
    for key in ("gyro", "vector_1", "bus_voltage"):
        first, second = recording[key], recording[key]
        assert np.shares_memory(first.values, second.values) and np.shares_memory(first.time_s, second.time_s)
        with pytest.raises(ValueError, match="read-only"):
            first.values[0] = 1.0
    gyro = recording["gyro"].values
    copy = gyro.copy()
    del recording, first, second
    gc.collect()
    whorl.read(run, platform="whorl_2")  # would write over memory that was given back
    np.testing.assert_array_equal(gyro, copy)


def test_own_arrays_units_and_missing_samples():
    time_s = np.array([100.0, 100.5, 101.0, 101.5])
    deg = np.array([[1.0, 2.0, 3.0], [np.nan, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]])
    given = {"gyro": (time_s, deg), "temperature": (time_s[:2], [20.0, 21.0]), "vector_2": (time_s, [[0, 3, 4]] * 4)}
    recording = whorl.Recording.from_arrays(
        given,
        units={"gyro": "deg/s", "temperature": "degC"},
        reference_world={"vector_2": [0, 2, 0]},
        jets=[[(100.25, 100.75)], []],
    )
    # Times count from the first; an incomplete sample is none; SI units.
    np.testing.assert_allclose(recording["gyro"].time_s, [0.0, 1.0, 1.5])
    np.testing.assert_allclose(recording["gyro"].values, np.deg2rad(deg[[0, 2, 3]]))
    np.testing.assert_allclose(recording["temperature"].values, [293.15, 294.15])
    np.testing.assert_allclose(recording["vector_1"].values[0], [0.0, 0.6, 0.8])
    np.testing.assert_allclose(recording.reference_world(), [0, 1, 0])
    np.testing.assert_allclose(recording.jet_pulses[0], [[0.25, 0.75]])
    assert recording.jet_pulses[1].shape == (0, 2)


@pytest.mark.parametrize("library", [pandas, polars])
def test_frames_of_either_library(library):
    rows = {"t": [0.0, 0.1, 0.2], "wx": [1.0, 2.0, 3.0], "wy": [0.0, None, 0.0], "wz": [0.5, 0.5, 0.5]}
    recording = whorl.Recording.from_frame(library.DataFrame(rows), {"gyro": ["wx", "wy", "wz"]}, time="t")
    np.testing.assert_array_equal(recording["gyro"].values, [[1.0, 0.0, 0.5], [3.0, 0.0, 0.5]])
    np.testing.assert_allclose(recording["gyro"].time_s, [0.0, 0.2])


def test_xarray_and_back(recording):
    again = whorl.Recording.from_xarray(recording.to_xarray(), model=recording.model)
    assert again.keys() == recording.keys()
    for key in recording:
        np.testing.assert_allclose(again[key].values, recording[key].values, rtol=0, atol=1e-14)
    assert recording["vector_1"].unit == "1" and recording.to_polars("vector_1").columns[1:] == ["vector_1_x", "vector_1_y", "vector_1_z"]
    frame = recording.to_polars("gyro")
    assert frame.columns == ["time_s", "gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s"]
    np.testing.assert_array_equal(frame["gyro_z_rad_s"].to_numpy(), recording["gyro"].values[:, 2])


TIMES = [0.0, 1.0, 2.0]


def test_sensors_of_one_axis():
    rate = np.array([0.1, 0.2, 0.3])
    for channels in ({"gyro_z": (TIMES, rate)}, {"gyro_z": (TIMES, rate.reshape(-1, 1))}):
        values = whorl.Recording.from_arrays(channels)["gyro"].values
        np.testing.assert_array_equal(values[:, 2], rate)
        assert np.isnan(values[:, :2]).all()
    frame = pandas.DataFrame({"t": TIMES, "w": rate})
    np.testing.assert_array_equal(whorl.Recording.from_frame(frame, {"gyro_x": "w"}, time="t")["gyro"].values[:, 0], rate)


def test_a_gyro_on_a_hinge_is_about_it(tmp_path, params):
    model = (params / "whorl_1.yaml").read_text()
    hinge = tmp_path / "whorl_1.yaml"
    hinge.write_text(model.replace("    model:\n", "    model:\n      freedom: {kind: hinge, axis: [0.0, 0.0, -1.0]}\n", 1))
    values = whorl.Recording.from_arrays({"gyro": (TIMES, [0.1, 0.2, 0.3])}, model=hinge)["gyro"].values
    np.testing.assert_array_equal(values[:, 2], [-0.1, -0.2, -0.3])
    assert np.isnan(values[:, :2]).all()


@pytest.mark.parametrize(
    ("channels", "given", "words"),
    [
        ({"gyro": (TIMES, np.zeros((3, 2)))}, {}, r"gyro: a sample has 2 numbers; allowed: 3 \(x, y, z\)"),
        ({"gyro": (TIMES, TIMES)}, {}, r"gyro: a sample has one number; allowed: \(n, 3\), or the name of the axis \(gyro_x"),
        ({"gyro_z": (TIMES, np.zeros((3, 2)))}, {}, r"gyro_z: values have shape \(3, 2\); allowed: \(n,\)"),
        ({"gyro": (TIMES, np.zeros((2, 3)))}, {}, "gyro: 3 times and 2 samples"),
        ({"gyro": (TIMES, np.zeros((3, 3, 1)))}, {}, r"gyro: values have shape \(3, 3, 1\)"),
        ({"gyro": ([TIMES], np.zeros((3, 3)))}, {}, r"gyro: times have shape \(1, 3\)"),
        ({"gyro": ([0.0, 1.0, 1.0], np.zeros((3, 3)))}, {}, "gyro: time 2 .* is not after the one before it"),
        ({"gyro": ([0.0, np.nan, 1.0], np.zeros((3, 3)))}, {}, "gyro: time 1 is NaN"),
        ({"gyro": (TIMES, [["a", "b", "c"]] * 3)}, {}, "gyro: allowed: numbers"),
        ({"gyro": TIMES}, {}, "gyro: allowed: a pair of times and values"),
        ({"giro": (TIMES, np.zeros((3, 3)))}, {}, "there is no channel giro; allowed: gyro,"),
        ({"gyro": (TIMES, np.zeros((3, 3)))}, {"units": {"gyro": "deg"}}, "there is no unit deg; allowed: rad/s, deg/s"),
        ({"gyro": (TIMES, np.zeros((3, 3)))}, {"units": {"gyros": "deg/s"}}, "units: gyros is not among the channels"),
        ({"vector_1": (TIMES, np.ones((3, 3)))}, {}, "vector_1: the direction that it sees in the world is not known"),
        ({"temperature": (TIMES, TIMES)}, {}, "no sample that measures motion: needed is one of gyro,"),
        (
            {"gyro": (TIMES, np.ones((3, 3))), "true_attitude": (TIMES, np.ones((3, 4)))},
            {},
            "true_attitude: the quaternion at 0 s has length 2.000; allowed: 1",
        ),
        (
            {"gyro": (TIMES, np.ones((3, 3)))},
            {"jets": [[(1.0, 0.5)]]},
            "jets: jet 1: a pulse from 1 s to 0.5 s; allowed",
        ),
    ],
)
def test_wrong_arrays_are_refused_with_what_is_allowed(channels, given, words):
    with pytest.raises(whorl.WhorlError, match=words):
        whorl.Recording.from_arrays(channels, **given)


def test_the_model_of_another_platform_is_refused(params):
    rows = {"wheel_speed": (TIMES, np.ones((3, 4)))}
    with pytest.raises(whorl.WhorlError, match="4 wheels, and the model whorl_1 has 3"):
        whorl.Recording.from_arrays(rows, model=params / "whorl_1.yaml")


def test_wrong_frames_are_refused():
    frame = pandas.DataFrame({"t": [0.0], "wx": [1.0]})
    with pytest.raises(whorl.WhorlError, match="there is no column time_s for the time; there are: t, wx"):
        whorl.Recording.from_frame(frame)
    with pytest.raises(whorl.WhorlError, match="gyro: there is no column wy; there are: t, wx"):
        whorl.Recording.from_frame(frame, {"gyro": ["wx", "wy", "wz"]}, time="t")


def test_notebooks_show_a_table(recording):
    text = recording._repr_html_()
    assert "<td>gyro</td><td>5701</td><td>100</td><td>rad/s</td><td>x, y, z</td>" in text


def test_a_cause_is_said_once(tmp_path):
    (tmp_path / "a.mcap").write_bytes(b"no bag at all, only some text that is long enough to be one")
    with pytest.raises(whorl.WhorlError) as error:
        whorl.read(tmp_path / "a.mcap")
    parts = str(error.value).split(": ")
    assert len(parts) > 1 and len(parts) == len(set(parts)), error.value


def test_an_accelerometer_may_lack_axes():
    t = np.arange(300) / 100
    force = np.column_stack([np.sin(t), np.full(300, np.nan), 9.8 + 0.01 * np.cos(t)])
    recording = whorl.Recording.from_arrays({"gyro": (t, np.column_stack([np.sin(t)] * 3)), "accelerometer": (t, force)})
    np.testing.assert_array_equal(recording["accelerometer"].values, force)

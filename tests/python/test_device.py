"""A body's motion in the memory of a device, as other libraries take it from there."""

import ctypes
import sys

import numpy as np
import pytest
import viscera
from conftest import falling

CAPSULE = b"dltensor"


def on_device(mesh, **params):
    try:
        return viscera.Simulation(mesh, falling(), device="cuda", **params)
    except viscera.Error as error:
        if error.exit_code == 6:
            pytest.skip(f"no CUDA device: {error.found}")
        raise


def read(address, shape, dtype):
    """By the driver alone, as another library would."""
    copy = np.empty(shape, dtype)
    driver = ctypes.CDLL("libcuda.so.1")
    assert driver.cuMemcpyDtoH_v2(ctypes.c_void_p(copy.ctypes.data), ctypes.c_void_p(address),
                                  ctypes.c_size_t(copy.nbytes)) == 0
    return copy


def test_on_the_cpu_it_is_in_the_hosts_memory(mesh):
    sim = viscera.Simulation(mesh, falling(), device="cpu")
    with pytest.raises(viscera.Error) as refused:
        sim.motion_on_device()
    assert refused.value.field == "device"
    assert "displacements" in refused.value.remedy


@pytest.mark.parametrize("scheme", ["gauss_seidel", "block_gauss_seidel"])
@pytest.mark.parametrize("precision, dtype", [("fp32", np.float32), ("fp64", np.float64)])
def test_it_is_what_the_host_reads(mesh, scheme, precision, dtype):
    sim = on_device(mesh, scheme=scheme, precision=precision)
    for _ in range(3):
        sim.step(2)
        for array, host in zip(sim.motion_on_device(), (sim.displacements, sim.velocities), strict=True):
            interface = array.__cuda_array_interface__
            address, read_only = interface["data"]
            assert read_only
            assert interface["shape"] == array.shape == host.shape
            assert np.dtype(interface["typestr"]) == dtype
            np.testing.assert_array_equal(read(address, host.shape, dtype), host.astype(dtype))


def test_dlpack_hands_on_the_same_memory_and_keeps_the_simulation_until_it_is_let_go(mesh):
    sim = on_device(mesh)
    sim.step()
    before = sys.getrefcount(sim)
    displacements, _ = sim.motion_on_device()
    assert displacements.__dlpack_device__() == (2, 0)  # CUDA's first
    capsule = displacements.__dlpack__(stream=1)
    pointer = ctypes.pythonapi.PyCapsule_GetPointer
    pointer.restype, pointer.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    data = ctypes.c_void_p.from_address(pointer(capsule, CAPSULE)).value  # the struct's first member
    assert data == displacements.__cuda_array_interface__["data"][0]
    for asked in ({"dl_device": (2, 1)}, {"dl_device": (1, 0)}, {"copy": True}):
        with pytest.raises(BufferError, match="allowed"):  # it lies where it lies
            displacements.__dlpack__(**asked)
    displacements.__dlpack__(dl_device=(2, 0), copy=False, max_version=(1, 0))
    del displacements, _
    assert sys.getrefcount(sim) == before + 1
    del capsule
    assert sys.getrefcount(sim) == before


def test_torch_sees_it_in_place(mesh):
    torch = pytest.importorskip("torch")
    sim = on_device(mesh)
    if not torch.cuda.is_available():
        pytest.skip("torch without CUDA")
    sim.step(3)
    there = torch.from_dlpack(sim.motion_on_device()[0])
    assert there.data_ptr() == sim.motion_on_device()[0].__cuda_array_interface__["data"][0]
    np.testing.assert_array_equal(there.cpu().numpy(), sim.displacements.astype(np.float32))

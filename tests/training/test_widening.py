"""A widened network computes what the narrow one does, and learns with its new channels."""

import pytest

torch = pytest.importorskip("torch", reason="needs the extra train")

from groundstation.files.channel_weights import WEIGHTS  # noqa: E402
from training.export import export_onnx, load_onnx  # noqa: E402
from training.network import ChannelNetwork, parameters_of  # noqa: E402
from training.widening import widened  # noqa: E402


def _trained_norms(network):
    """Give the norms values that are not those of a new network, of which the exporter keeps equal ones once."""
    generator = torch.Generator().manual_seed(4)
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            for values, middle in ((module.running_mean, 0.0), (module.running_var, 1.0)):
                values.copy_(torch.rand(values.shape, generator=generator) - 0.5 + middle)
            for values, middle in ((module.bias, 0.0), (module.weight, 1.0)):
                values.data.copy_(torch.rand(values.shape, generator=generator) - 0.5 + middle)
    return network


def _windows(seed=3):
    return 255.0 * torch.rand((2, 3, 96, 128), generator=torch.Generator().manual_seed(seed))


def test_a_widened_network_gives_the_same_maps_and_its_new_channels_learn():
    narrow = _trained_norms(ChannelNetwork(24, 40)).eval()
    wide = widened(narrow, 32, 56).eval()
    assert parameters_of(wide) > parameters_of(narrow)
    with torch.no_grad():
        torch.testing.assert_close(wide(_windows()), narrow(_windows()), rtol=1e-4, atol=1e-4)
    wide.train()(_windows()).square().mean().backward()
    joint = wide.to_eighth.first.weight.grad
    # from the new channels of either resolution to the old ones
    assert float(joint[:24, 40:56].abs().max()) > 0.0
    assert float(joint[:24, 56 + 24 :].abs().max()) > 0.0


def test_a_network_is_not_widened_to_fewer_channels():
    with pytest.raises(ValueError, match=r"\(24, 40\) channels is not widened to \(24, 32\)"):
        widened(ChannelNetwork(24, 40), 24, 32)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_weights_of_a_narrower_network_are_read(tmp_path):
    narrow = _trained_norms(ChannelNetwork(48, 64))
    export_onnx(narrow, tmp_path / "narrow.onnx")
    with torch.no_grad():
        maps = load_onnx(tmp_path / "narrow.onnx").eval()(_windows())
        torch.testing.assert_close(maps, narrow.eval()(_windows()), rtol=1e-4, atol=1e-4)


def test_the_weights_of_the_program_can_be_trained_further():
    assert parameters_of(load_onnx(WEIGHTS)) == parameters_of(ChannelNetwork())

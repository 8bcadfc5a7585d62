"""pyusb on an emulated bus: the bytes as over libusb, and errors for missing devices."""

import errno

import pytest
import usb.backend
import usb.core

from palpate.drivers.errors import DeviceError
from palpate.drivers.falcon import NAME, PRODUCT, VENDOR
from palpate.drivers.falcon.driver import FalconDriver
from palpate.drivers.falcon.emulator import IMAGE, EmulatedFalcon
from palpate.drivers.transport.ftdi import UsbFtdi


class Descriptor:
    """Descriptors of a device, its configuration, interface and endpoints, as libusb returns them to pyusb."""

    def __init__(self, **fields):
        self.__dict__.update(fields)


class Bus(usb.backend.IBackend):
    """A bus with Falcons; `refuse` is the errno of claiming one."""

    def __init__(self, *falcons, refuse=0):
        self.falcons, self.refuse, self.pulled = falcons, refuse, False

    def enumerate_devices(self):
        return iter(range(len(self.falcons)))

    def get_device_descriptor(self, dev):
        return Descriptor(
            bLength=18, bDescriptorType=1, bcdUSB=0x200, bDeviceClass=0, bDeviceSubClass=0, bDeviceProtocol=0,
            bMaxPacketSize0=8, idVendor=VENDOR, idProduct=PRODUCT, bcdDevice=0x600, iManufacturer=0, iProduct=0,
            iSerialNumber=0, bNumConfigurations=1, address=4 + dev, bus=1, port_number=1, port_numbers=(1,), speed=2,
        )  # fmt: skip

    def get_configuration_descriptor(self, dev, config):
        if config:
            raise IndexError
        return Descriptor(
            bLength=9, bDescriptorType=2, wTotalLength=32, bNumInterfaces=1, bConfigurationValue=1, iConfiguration=0,
            bmAttributes=0x80, bMaxPower=50, extra_descriptors=[],
        )  # fmt: skip

    def get_interface_descriptor(self, dev, intf, alt, config):
        if intf or alt:
            raise IndexError
        return Descriptor(
            bLength=9, bDescriptorType=4, bInterfaceNumber=0, bAlternateSetting=0, bNumEndpoints=2, bInterfaceClass=255,
            bInterfaceSubClass=255, bInterfaceProtocol=255, iInterface=0, extra_descriptors=[],
        )  # fmt: skip

    def get_endpoint_descriptor(self, dev, ep, intf, alt, config):
        if ep > 1:
            raise IndexError
        return Descriptor(
            bLength=7, bDescriptorType=5, bEndpointAddress=(0x81, 0x02)[ep], bmAttributes=2, wMaxPacketSize=64,
            bInterval=0, bRefresh=0, bSynchAddress=0, extra_descriptors=[],
        )  # fmt: skip

    def open_device(self, dev):
        return dev

    def close_device(self, handle):
        pass

    def get_configuration(self, handle):
        return 1

    def is_kernel_driver_active(self, handle, intf):
        return False

    def claim_interface(self, handle, intf):
        if self.refuse:
            raise usb.core.USBError("refused", None, self.refuse)
        self.chip = self.falcons[handle].connect()

    def release_interface(self, handle, intf):
        pass

    def _there(self):
        if self.pulled:
            raise usb.core.USBError("No such device", None, errno.ENODEV)

    def ctrl_transfer(self, handle, kind, request, value, index, data, timeout):
        self._there()
        assert (kind, index) == (0x40, 0)
        self.chip.control(request, value)
        return 0

    def bulk_write(self, handle, ep, intf, data, timeout):
        self._there()
        assert ep == 0x02
        self.chip.write(bytes(data))
        return len(data)

    def bulk_read(self, handle, ep, intf, buffer, timeout):
        self._there()
        assert ep == 0x81 and len(buffer) == 64
        packet = self.chip.read(timeout * 1e-3)
        if not packet:
            raise usb.core.USBTimeoutError("timed out", None, errno.ETIMEDOUT)
        buffer[: len(packet)] = type(buffer)("B", packet)
        return len(packet)


def connect(bus, port=""):
    return UsbFtdi(VENDOR, PRODUCT, NAME, port, bus)


def test_a_falcon_on_usb_loads_its_firmware_and_answers():
    falcon = EmulatedFalcon(image=IMAGE[:700], homing=0.0)
    bus = Bus(falcon)
    driver = FalconDriver(lambda: connect(bus), lambda: IMAGE[:700])
    driver.open()
    assert falcon.running
    samples = [driver.cycle((0.0, 0.0, 0.0)) for _ in range(30)]
    assert any(s is not None and s.homed for s in samples)
    bus.pulled = True
    with pytest.raises(DeviceError, match="is gone") as raised:
        driver.cycle((0.0, 0.0, 0.0))
    assert raised.value.lost
    driver.close()


def test_missing_and_ambiguous_devices_are_errors_with_a_remedy():
    with pytest.raises(DeviceError, match=r"no Novint Falcon on USB \(0403:cb48\)\. Plug it in"):
        connect(Bus())
    two = Bus(EmulatedFalcon(), EmulatedFalcon())
    with pytest.raises(DeviceError, match=r"2 devices are a Novint Falcon\. Say which one with `port`: 1:4, 1:5"):
        connect(two)
    connect(two, "1:5")
    with pytest.raises(DeviceError, match=r"no Novint Falcon at port '9:9'\. There are: 1:4, 1:5"):
        connect(two, "9:9")


@pytest.mark.parametrize(
    ("number", "text"),
    [(errno.EACCES, r"no permission .*--install-udev"), (errno.EBUSY, "in use by another program")],
)
def test_a_refused_device_is_an_error_with_the_reason(number, text):
    with pytest.raises(DeviceError, match=text):
        connect(Bus(EmulatedFalcon(), refuse=number))


def test_a_missing_package_is_an_error_with_the_command_to_install_it(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "usb.core", None)
    with pytest.raises(DeviceError, match=r'pip install "palpate\[devices\]"'):
        UsbFtdi(VENDOR, PRODUCT, NAME)

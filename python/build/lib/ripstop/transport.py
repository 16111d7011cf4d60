"""Shared memory between processes: the only module that names iceoryx2.

The coupler makes all services; a participant opens them with the same settings."""

import ctypes
import os
import time

import iceoryx2 as iox
import numpy as np

from .contract import Header, Kind, Unit, pack_text
from .table import ALIGNMENT, BUFFER, MEMORY


class Link:
    """This process's connection to a session."""

    def __init__(self, place, name):
        iox.set_log_level_from_env_or(iox.LogLevel.Fatal)
        config = iox.config.default()
        config.global_cfg.prefix = iox.FileName.new(place.prefix)
        config.global_cfg.root_path = iox.Path.new(str(place.folder))
        # The coupler removes a session as a whole: nobody tidies up after another.
        config.global_cfg.node.cleanup_dead_nodes_on_creation = False
        config.global_cfg.node.cleanup_dead_nodes_on_destruction = False
        config.global_cfg.service.cleanup_dead_nodes_on_open = False
        self.node = (
            iox.NodeBuilder.new()
            .name(iox.NodeName.new(name))
            .config(config)
            .signal_handling_mode(iox.SignalHandlingMode.Disabled)
            .create(iox.ServiceType.Ipc)
        )

    def _channel(self, name, receivers, newest_wins):
        return (
            self.node.service_builder(iox.ServiceName.new(name))
            .publish_subscribe(iox.Slice[ctypes.c_double])
            .user_header(Header)
            .payload_alignment(iox.Alignment.new(ALIGNMENT))
            .max_publishers(1)
            .max_subscribers(receivers)
            .max_nodes(receivers + 2)
            .subscriber_max_buffer_size(BUFFER)
            .subscriber_max_borrowed_samples(BUFFER)
            .history_size(0)
            .enable_safe_overflow(newest_wins)
            .open()
        )

    def _bell(self, name, sleepers, ringers):
        return (
            self.node.service_builder(iox.ServiceName.new(name))
            .event()
            .max_listeners(sleepers)
            .max_notifiers(ringers)
            .max_nodes(sleepers + ringers + 1)
            .event_id_max_value(1)
            .open()
        )

    def sender(self, name, words, receivers=1, newest_wins=False):
        """The sending end of a channel for messages of at most `words` numbers."""
        # Memory is taken when it is written: running out of it then would kill the process.
        free = os.statvfs(MEMORY)
        if 24 * words > free.f_bavail * free.f_frsize:
            raise MemoryError(f"`{name}` needs {24 * words // 10**6} MB in {MEMORY}: make room or enlarge it")
        publisher = (
            self._channel(name, receivers, newest_wins)
            .publisher_builder()
            .initial_max_slice_len(max(words, 1))
            .max_loaned_samples(1)
            .backpressure_strategy(iox.BackpressureStrategy.DiscardData)
            .override_sample_preallocation(2 * BUFFER + 2)
            .create()
        )
        return Sender(publisher, words)

    def receiver(self, name, receivers=1, newest_wins=False):
        """The receiving end of a channel."""
        return Receiver(self._channel(name, receivers, newest_wins).subscriber_builder().create())

    def sleeper(self, name, sleepers, ringers):
        """Sleeps until a bell rings."""
        return Sleeper(self._bell(name, sleepers, ringers).listener_builder().create())

    def ringer(self, name, sleepers, ringers):
        """Rings a bell."""
        return Ringer(self._bell(name, sleepers, ringers).notifier_builder().create())


def numbers(pointer, length):
    """Shared memory as an array."""
    return np.frombuffer((ctypes.c_double * length).from_address(pointer), dtype="<f8")


class Loan:
    """A message being written in shared memory; all NaN at first: what is left out shows."""

    def __init__(self, sample, words):
        self.sample = sample
        self.payload = numbers(sample.payload_ptr, words)
        self.payload.fill(np.nan)

    def send(self, header):
        """Sends it; how many receivers got it."""
        ctypes.memmove(self.sample.user_header_ptr, ctypes.byref(header), ctypes.sizeof(Header))
        sample, self.sample, self.payload = self.sample, None, None
        return sample.assume_init().send()

    def drop(self):
        """Gives the memory back unsent."""
        self.sample.delete()
        self.sample = self.payload = None


class Sender:
    """The one sender of a channel."""

    def __init__(self, publisher, words):
        self.publisher, self.words = publisher, words

    def loan(self, words):
        """Memory for a message of `words` numbers."""
        return Loan(self.publisher.loan_slice_uninit(words), words)

    def send(self, header):
        """Sends a message without numbers; how many receivers got it."""
        return self.loan(0).send(header)

    def send_text(self, header, text):
        """Sends a text, cut to what fits; how many receivers got it."""
        header.bytes, words = pack_text(text, self.words)
        header.unit, header.length = Unit.TEXT, len(words)
        loan = self.loan(len(words))
        # As bits: a text may look like a signalling NaN.
        loan.payload.view("<u8")[:] = words.view("<u8")
        return loan.send(header)

    def close(self):
        """Frees the sending end."""
        self.publisher.delete()


class Message:
    """A received message, borrowed from shared memory until `drop`."""

    def __init__(self, sample):
        self.sample = sample
        self.header = Header.from_buffer_copy((ctypes.c_char * ctypes.sizeof(Header)).from_address(sample.user_header_ptr))
        self.payload = numbers(sample.payload_ptr, sample.header.number_of_elements)
        self.payload.flags.writeable = False

    @property
    def kind(self):
        """Its kind, or None for an unknown code."""
        return Kind._value2member_map_.get(self.header.kind)

    def drop(self):
        """Gives the memory back."""
        self.payload = None
        self.sample.delete()


class Receiver:
    """A receiver of a channel."""

    def __init__(self, subscriber):
        self.subscriber = subscriber

    def receive(self):
        """The next message, or None."""
        sample = self.subscriber.receive()
        return None if sample is None else Message(sample)

    def close(self):
        """Frees the receiving end."""
        self.subscriber.delete()


class Sleeper:
    """Sleeps in the kernel until somebody rings."""

    def __init__(self, listener):
        self.listener = listener

    def sleep(self, seconds):
        """Returns after a ring, also one from before the call, or after `seconds`."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 1e-4:
            if self.listener.timed_wait(iox.Duration.from_secs_f64(left)):
                return
        self.listener.try_wait()

    def close(self):
        """Frees the bell."""
        self.listener.delete()


class Ringer:
    """Wakes the sleepers of a bell."""

    def __init__(self, notifier):
        self.notifier = notifier

    def ring(self):
        """Notifies. A listener that has ended is no error here: its lock shows it."""
        try:
            self.notifier.notify()
        except iox.NotifierNotifyError:
            pass

    def close(self):
        """Frees the bell."""
        self.notifier.delete()

"""A ROS 2 network in one process: messages cross as CDR, and who subscribes can act as soon as one has come."""

import itertools
import time

from vuca_nav.deploy.transport.interface import Publisher, Qos, Received, Refusals, Subscriber, Transport
from vuca_nav.deploy.transport.ros_types import decode, encode

_DEFAULT = Qos()


class Network:
    """The topics that all sides share."""

    def __init__(self):
        self.subscribers = []
        self.publishers = []
        self.latched = {}
        self.numbers = itertools.count(1)

    def join(self):
        return Loopback(self)


class Loopback(Transport):
    """One side."""

    def __init__(self, network):
        self.network, self.refusals = network, Refusals()

    def advertise(self, topic, type_name, qos=_DEFAULT):
        publisher = LoopbackPublisher(self.network, self.full_name(topic), type_name, qos)
        self.network.publishers.append(publisher)
        return publisher

    def subscribe(self, topic, type_name, qos=_DEFAULT):
        subscriber = LoopbackSubscriber(self.network, self.full_name(topic), type_name, qos)
        self.network.subscribers.append(subscriber)
        return subscriber

    def wait(self, timeout):
        time.sleep(min(timeout, 0.002))
        return True

    def full_name(self, name):
        return name if name.startswith("/") else f"/{name}"

    def serve(self, name, type_name):
        raise NotImplementedError

    def client(self, name, type_name):
        raise NotImplementedError

    def publishers(self, topic):
        return ()

    def close(self):
        pass


class LoopbackPublisher(Publisher):
    def __init__(self, network, topic, type_name, qos):
        self.network, self.topic, self.type_name, self.qos = network, topic, type_name, qos
        self.number = next(network.numbers)

    def publish(self, message):
        data = encode(message, self.type_name)
        received = Received(decode(data, self.type_name), data, self.number, time.time_ns())
        if self.qos.transient_local:
            self.network.latched[self.topic] = received
        for subscriber in self._heard_by():
            subscriber.waiting.append(received)
            subscriber.notify()
        return data

    def _heard_by(self):
        return [s for s in self.network.subscribers if (s.topic, s.type_name) == (self.topic, self.type_name)]

    @property
    def subscribers(self):
        return len(self._heard_by())

    def flush(self, timeout):
        return True


class LoopbackSubscriber(Subscriber):
    def __init__(self, network, topic, type_name, qos):
        self.network, self.topic, self.type_name = network, topic, type_name
        self.notify = lambda: None
        self.waiting = [network.latched[topic]] if qos.transient_local and topic in network.latched else []

    def take(self):
        taken, self.waiting = self.waiting, []
        return taken

    @property
    def publishers(self):
        return len([p for p in self.network.publishers if (p.topic, p.type_name) == (self.topic, self.type_name)])

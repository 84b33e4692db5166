"""A proxy between a client and a server that loses, doubles and delays messages. A client must come through without
noticing."""
import time

import zmq

FAULTS = ("lose_request", "lose_reply", "double_request", "double_reply", "delay_reply")
PLAN = {  # by the number of a request that the client sends for the first time, hello being 0
    2: "lose_reply", 5: "lose_request", 8: "lose_reply", 11: "double_request", 14: "double_reply", 17: "delay_reply",
    20: "double_reply", 23: "lose_request"
}


class LossyProxy:
    def __init__(self, delay):
        self.delay = delay  # of a delayed reply, s
        self.done = []  # faults that were made
        self._seen = set()

    def serve(self, front, back, stop):
        """Passes messages on until `stop` says so. Each client gets a socket of its own to the server, so the server
        sees as many peers."""
        context = zmq.Context.instance()
        router = context.socket(zmq.ROUTER)
        router.setsockopt(zmq.LINGER, 200)
        router.bind(front)
        links, late, replies = {}, [], {}  # peer -> socket; (time, message); (peer, request id) -> fault of its reply
        while not stop():
            poller = zmq.Poller()
            for socket in (router, *links.values()):
                poller.register(socket, zmq.POLLIN)
            ready = dict(poller.poll(10))
            if router in ready:
                peer, *frames = router.recv_multipart()
                self._request(context, back, links, replies, peer, frames)
            for peer, socket in links.items():
                if socket not in ready:
                    continue
                frames = socket.recv_multipart()
                fault = replies.pop((peer, self._id(frames)), None)
                if fault == "delay_reply":
                    late.append((time.monotonic() + self.delay, [peer, *frames]))
                elif fault != "lose_reply" and isinstance(peer, bytes):
                    for _ in range(2 if fault == "double_reply" else 1):
                        router.send_multipart([peer, *frames])
            while late and time.monotonic() > late[0][0]:
                router.send_multipart(late.pop(0)[1])
        for socket in (router, *links.values()):
            socket.close(200)

    def _request(self, context, back, links, replies, peer, frames):
        def link(name):
            if name not in links:
                links[name] = context.socket(zmq.DEALER)
                links[name].connect(back)
            return links[name]

        fault = None
        if tuple(frames) not in self._seen:
            fault = PLAN.get(len(self._seen))
            self._seen.add(tuple(frames))
            if fault:
                self.done.append(fault)
        if fault == "lose_request":
            return
        if fault in ("lose_reply", "double_reply", "delay_reply"):
            replies[peer, self._id(frames)] = fault
        link(peer).send_multipart(frames)
        if fault == "double_request":
            link(("copy", peer)).send_multipart(frames)  # the reply to a copy goes to nobody

    @staticmethod
    def _id(frames):
        """Returns the bytes of field 4, request_id (fixed64), which headers have near their beginning."""
        at = frames[0].find(b"\x21")
        return frames[0][at + 1 : at + 9]

"""Numbers of the system calls that a line is refused or bounded in, by machine.

Source:
    Linux, arch/x86/entry/syscalls/syscall_64.tbl; include/uapi/asm-generic/unistd.h.
"""

from __future__ import annotations

NUMBERS: dict[str, tuple[int, int, dict[str, int]]] = {
    "x86_64": (
        0xC000003E,
        317,
        {"socket": 41, "execve": 59, "execveat": 322, "ptrace": 101, "process_vm_readv": 310}
        | {"process_vm_writev": 311, "mount": 165, "umount2": 166, "pivot_root": 155}
        | {"chroot": 161, "unshare": 272, "setns": 308, "bpf": 321, "perf_event_open": 298}
        | {"init_module": 175, "finit_module": 313, "kexec_load": 246, "keyctl": 250}
        | {"add_key": 248, "request_key": 249, "userfaultfd": 323, "open_by_handle_at": 304}
        | {"io_uring_setup": 425, "pidfd_getfd": 438},
    ),
    "aarch64": (
        0xC00000B7,
        277,
        {"socket": 198, "execve": 221, "execveat": 281, "ptrace": 117, "process_vm_readv": 270}
        | {"process_vm_writev": 271, "mount": 40, "umount2": 39, "pivot_root": 41}
        | {"chroot": 51, "unshare": 97, "setns": 268, "bpf": 280, "perf_event_open": 241}
        | {"init_module": 105, "finit_module": 273, "kexec_load": 104, "keyctl": 219}
        | {"add_key": 217, "request_key": 218, "userfaultfd": 282, "open_by_handle_at": 265}
        | {"io_uring_setup": 425, "pidfd_getfd": 438},
    ),
}
"""By machine: its name for the kernel, the number of seccomp, and what is refused."""

WIRES: dict[str, tuple[int, dict[str, tuple[int, int]]]] = {
    "x86_64": (42, {"sendto": (44, 40), "sendmsg": (46, 32), "sendmmsg": (307, 40)}),
    "aarch64": (203, {"sendto": (206, 40), "sendmsg": (211, 32), "sendmmsg": (269, 40)}),
}
"""By machine: connect, and what sends, with the place of its flags among the arguments."""

OTHERS: dict[str, tuple[dict[str, int], dict[str, int]]] = {
    "x86_64": (
        {"setpriority": 141, "ioprio_set": 251, "listen": 50},
        {"prlimit64": 302, "sched_setaffinity": 203, "sched_setattr": 314}
        | {"sched_setparam": 142, "sched_setscheduler": 144},
    ),
    "aarch64": (
        {"setpriority": 140, "ioprio_set": 30, "listen": 201},
        {"prlimit64": 261, "sched_setaffinity": 122, "sched_setattr": 274}
        | {"sched_setparam": 118, "sched_setscheduler": 119},
    ),
}
"""By machine: what else is refused, and what may be done to who asks (process 0) alone.

A bound on the processor's time ends any process of the same user, and is no signal for Landlock;
`listen` without `bind` takes a port that Landlock does not see.
"""

PAIR = {"x86_64": 53, "aarch64": 199}
"""By machine: socketpair. A pair of datagrams can be connected to any local socket later."""

STARTS: dict[str, tuple[int, int, tuple[int, ...]]] = {
    "x86_64": (56, 435, (57, 58)),
    "aarch64": (220, 435, ()),
}
"""By machine: clone, clone3, and what else starts a process (fork, vfork)."""

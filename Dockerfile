# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
# docker build -t dolfinx-joints . && docker run -it --rm -v "$PWD":/work -w /work dolfinx-joints
ARG DOLFINX=v0.11.0
FROM dolfinx/dolfinx:${DOLFINX}

RUN apt-get update && apt-get install -y --no-install-recommends \
    libegl1 libpango-1.0-0 libpangoft2-1.0-0 libharfbuzz-subset0 && \
    rm -rf /var/lib/apt/lists/*
# h5py is built on the HDF5 of DOLFINx: two of them in one process disagree.
RUN HDF5_DIR=/usr/local HDF5_MPI=ON CC=mpicc \
    pip install --break-system-packages --no-cache-dir --no-binary=h5py h5py
COPY . /opt/dolfinx_joints
RUN pip install --break-system-packages --no-cache-dir "/opt/dolfinx_joints[views,reports,pdf]"
CMD ["bash"]

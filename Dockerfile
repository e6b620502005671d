# docker build -t ndtorch . && docker run --rm -v "$PWD/out:/ndtorch/out" ndtorch
FROM python:3.12-slim-bookworm
RUN apt-get update && apt-get install -y --no-install-recommends make libglib2.0-0 \
    && rm -rf /var/lib/apt/lists/*
ENV PIP_EXTRA_INDEX_URL=https://download.pytorch.org/whl/cpu
WORKDIR /ndtorch
COPY . .
RUN make setup PYTHON=python3
CMD ["make", "demo"]

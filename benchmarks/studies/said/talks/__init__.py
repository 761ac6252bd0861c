"""The statements and figures of two talks on symplectic integration: each judged, each measured and drawn again."""

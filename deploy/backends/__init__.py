"""Renderers of the same plan for what a site starts things with. Pure: plan in, text out."""
